"""An uploaded plan in space: its way and items, the fence, rally points and home.

Frame: Earth East-North-Up, metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.view.multicopter import Colour
from gcs_tools.recording.plans import PlanAt, way

if TYPE_CHECKING:
    import viser

PLAN: Colour = (120, 94, 160)
INSIDE: Colour = (0, 158, 115)
OUTSIDE: Colour = (200, 40, 40)
NAMED = 200  # items that have their number beside them
OVER_M = 3.0  # of a fence above what is highest of the plan
AROUND_M = 1e4  # what is farther away is not drawn

Lines = np.ndarray[Any, np.dtype[np.float32]]


def walls(corners: tuple[tuple[float, float], ...], low: float, high: float) -> Lines:
    """The outline of an area at two heights, and upright lines between them, (n, 2, 3), m."""
    round_it = np.array([*corners, corners[0]])
    rings = [np.column_stack([round_it, np.full(len(round_it), z)]) for z in (low, high)]
    lines = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
    upright = np.stack([rings[0][:-1], rings[1][:-1]], axis=1)
    return np.concatenate([*lines, upright[:: max(1, len(upright) // 24)]]).astype(np.float32)


class DrawnPlan:
    """The plan of one flight, as it is at the time that is shown."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene, self._name = scene, name
        self._root: Any = None
        self._shown = PlanAt()
        self._next: Any = None

    def show(self, plan: PlanAt, ground_z: float | None) -> None:
        """Draw a plan, and which item is next.  ground_z : m, where that is known."""
        if plan._replace(current=0) != self._shown._replace(current=0):
            self._draw(plan, 0.0 if ground_z is None else ground_z)
        elif plan.current == self._shown.current:
            return
        self._shown = plan
        if self._next is None:
            return
        item = plan.mission[plan.current] if plan.current < len(plan.mission) else None
        place = None if item is None else item.at(plan.home)
        self._next.visible = place is not None
        if place is not None:
            self._next.position = place

    def _draw(self, plan: PlanAt, ground_z: float) -> None:
        if self._root is not None:
            self._root.remove()  # and all that hangs on it
        self._root = self._next = None
        if not (plan.mission or plan.fence or plan.rally):
            return
        scene, name = self._scene, self._name
        self._root = scene.add_frame(name, show_axes=False)
        places = np.array(way(plan), np.float64).reshape(-1, 3)
        places = places[(np.abs(places) < AROUND_M).all(axis=1)]
        if len(places) > 1:
            line = np.stack([places[:-1], places[1:]], axis=1).astype(np.float32)
            scene.add_line_segments(
                f"{name}/way", line, PLAN, thickness=1.6, thickness_units="screen"
            )
        for number, item in enumerate(plan.mission[:NAMED]):
            r = item.at(plan.home)
            if r is not None:
                scene.add_icosphere(f"{name}/item{number}", 0.16, PLAN, position=r, cast_shadow=False)  # fmt: skip
                scene.add_label(f"{name}/number{number}", str(number), position=r, anchor="bottom-left")  # fmt: skip
        self._next = scene.add_icosphere(
            f"{name}/next", 0.34, PLAN, opacity=0.4, cast_shadow=False, visible=False
        )
        high = (float(places[:, 2].max()) if len(places) else ground_z) + OVER_M
        for number, area in enumerate(plan.fence):
            colour = INSIDE if area.inclusion else OUTSIDE
            scene.add_line_segments(
                f"{name}/area{number}", walls(area.corners, ground_z + 0.02, high), colour,
                thickness=2.0, thickness_units="screen",
            )  # fmt: skip
        home = () if plan.home is None else (("home", plan.home),)
        for word, r in (*home, *(("rally point", point) for point in plan.rally)):
            at = f"{name}/{word.replace(' ', '_')}_{r.x:.3f}_{r.y:.3f}".replace("-", "m")
            place = (r.x, r.y, ground_z + 0.02)
            scene.add_cylinder(at, 0.6, 0.02, PLAN, opacity=0.7, position=place, cast_shadow=False)
            scene.add_label(f"{at}_name", word, position=place, anchor="top-center")
