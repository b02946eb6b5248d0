"""A plan in the scene: drawn once, and its next item moved."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from fcu.kernel.algebra import Vec3
from gcs_tools.pictures.view.plan import DrawnPlan
from gcs_tools.recording.plans import FencedArea, PlanAt, PlanItem


class Drawing:
    """Keeps what is added, by name."""

    def __init__(self):
        self.nodes = {}

    def __getattr__(self, what):
        def add(name, *arguments, **options):
            node = SimpleNamespace(what=what, arguments=arguments, remove=lambda: self._drop(name))
            for key, value in options.items():
                setattr(node, key, value)
            self.nodes[name] = node
            return node

        return add

    def _drop(self, name):
        for each in [n for n in self.nodes if n == name or n.startswith(f"{name}/")]:
            del self.nodes[each]


def item(command, *place):
    return PlanItem(command, 3, (0.0, 0.0, 0.0, math.nan), 0.0, 0.0, 5.0, True, Vec3(*place))


NOWHERE = 3 * (math.nan,)
PLAN = PlanAt(
    (item("NAV_TAKEOFF", 0.0, 0.0, 5.0), item("DO_CHANGE_SPEED", *NOWHERE), item("NAV_WAYPOINT", 9.0, 4.0, 5.0)),
    (FencedArea(True, ((-9.0, -9.0), (20.0, -9.0), (0.0, 20.0))),),
    (Vec3(3.0, 3.0, 0.0),),
    Vec3(0.0, 0.0, 1.0),
)  # fmt: skip


def test_all_of_a_plan_is_drawn_with_the_height_of_home():
    scene = Drawing()
    DrawnPlan(scene, "/plan").show(PLAN, 0.0)
    assert scene.nodes["/plan/item2"].position == (9.0, 4.0, 6.0)
    assert "/plan/item1" not in scene.nodes
    assert scene.nodes["/plan/way"].arguments[0].shape == (2, 2, 3)
    assert scene.nodes["/plan/area0"].arguments[0].shape == (9, 2, 3)
    labels = [node.arguments[0] for node in scene.nodes.values() if node.what == "add_label"]
    assert sorted(labels) == ["0", "2", "home", "rally point"]


def test_the_item_that_is_next_is_marked_and_nothing_else_drawn_again():
    scene = Drawing()
    drawn = DrawnPlan(scene, "/plan")
    drawn.show(PLAN, 0.0)
    before = dict(scene.nodes)
    for current, place in ((0, (0.0, 0.0, 6.0)), (1, None), (2, (9.0, 4.0, 6.0)), (3, None)):
        drawn.show(PLAN._replace(current=current), 0.0)
        mark = scene.nodes["/plan/next"]
        assert mark.visible is (place is not None)
        assert place is None or mark.position == pytest.approx(place)
    assert scene.nodes == before
    drawn.show(PlanAt(), 0.0)
    assert scene.nodes == {}
