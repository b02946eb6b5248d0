"""A flight is judged as a whole: what it missed, and the sentences that say why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fcu.interface.event_log import event
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.process.tick import Tick
from gcs_tools.judging.result import Result, judge
from gcs_tools.missions.mission import Mission, load, override, with_law
from gcs_tools.missions.timeline import Begun, timeline
from gcs_tools.recording.table import Rows
from sitl_plant.physics.types import PlantRecord
from tests.judging.test_metrics import put

RATE = 100.0  # Hz
SCRIPT = str(Path(__file__).parents[1] / "scripts" / "hop.toml")
ABOUT = {"wall_time_s": 1.0, "startup_s": 0.1, "slips": 0, "versions": {}}
PATH = """title = "A path."
[flight]
duration_s = 60.0
rate_hz = 100
ground_z_m = 0.0
start = { on_ground = true }
items = [
    { kind = "take_off", height_m = 3.0 },
    { kind = "follow", points_m = [[0, 0, 3], [5, 0, 3]] },
]
"""


def flight(mission: Mission, seconds: float, **told: float) -> tuple[Rows, Rows]:
    """A vehicle that rests at the origin, and from half of the time on its law tells something more."""
    n, kind = round(seconds * RATE), mission.flown.ticks.Tick
    plant, fcu = np.zeros((n, size(PlantRecord))), np.zeros((n, size(kind)))
    plant[:, 0] = fcu[:, 0] = np.arange(n) / RATE
    put(plant, PlantRecord, "m", 8.0)
    put(fcu, kind, "engaged", 2.0)
    for name, value in told.items():
        at = columns(kind).index(f"outputs.saturation.{name}")
        fcu[n // 2 :, at] = value
    return plant, fcu


def judged(mission: Mission, plant: Rows, fcu: Rows, **given: Any) -> Result:
    chosen: dict[str, Any] = {"ended": "time", "exit_code": 0, "error": None, **ABOUT, **given}
    return judge(mission, RATE, plant, fcu, **chosen)


def test_a_flight_that_saturated_and_missed_is_told_its_limit_its_air_and_where_to_look() -> None:
    mission = override(load("gust_step"), "expect.thrust_saturated_fraction=0.1")
    found = judged(mission, *flight(mission, 4.0, thrust=1.0))
    assert not found.passed
    limit, air, look = found.causes
    assert limit == "At a limit: the thrust command from 2.00 s to the end (50 % of the flight)."
    assert air.startswith("The wind reached 0.0 m/s, within the 12 m/s believed")
    assert look.startswith("What uses up the margin: gcs envelope ")
    assert "gust_step" in look


def test_a_failsafe_that_landed_it_is_told_first_and_what_followed_is_left_out() -> None:
    mission = override(load("gust_step"), "expect.thrust_saturated_fraction=0.1")
    acts = (Told(Code.ROTOR_LOST, (1, Told(Code.LOSS_LANDS))), Told(Code.FAILSAFE_MODE, ("Land",)))
    plant, fcu = flight(mission, 8.0, thrust=1.0)
    plant[400:, columns(PlantRecord).index("state.r_E.z")] -= 3.0

    def told_at(at_s: float) -> Result:
        said = [event(at_s, "fatal", "fcu", each) for each in acts]
        return judged(mission, plant, fcu, said=said)

    found = told_at(4.1)
    assert found.causes == [
        "The failsafe rotor_lost acted at 4.10 s (Land): from then on the vehicle did not fly to its setpoints."
    ]
    (reached,) = (each.why for each in found.expectations if each.name == "reached")
    assert "more time" not in reached and "Ask" not in reached
    late = told_at(7.0).causes
    assert late[0].startswith("The failsafe rotor_lost acted at 7.00 s")
    assert late[1].startswith("At a limit: the thrust command first at 4.00 s"), "before it"


def test_a_law_without_a_guard_is_sent_to_no_margin() -> None:
    mission = with_law(load("gust_step"), "px4")
    found = judged(mission, *flight(mission, 4.0, thrust=1.0))
    assert found.causes[0].startswith("At a limit: the thrust command")
    assert not [each for each in found.causes if "gcs envelope" in each]


@pytest.mark.parametrize("name", ["plan_square", SCRIPT])
def test_a_flight_by_a_plan_or_a_script_is_sent_to_no_margin(name) -> None:
    found = judged(load(name), *flight(load(name), 4.0, thrust=1.0))
    assert [each for each in found.causes if each.startswith("At a limit: the thrust command")]
    assert not [each for each in found.causes if "gcs envelope" in each]


@pytest.mark.parametrize(("expected", "causes"), [("0.9", 0), ("0.1", 3)])
def test_limits_of_the_allocation_are_told_of_a_flight_that_missed_alone(expected, causes) -> None:
    mission = override(load("gust_step"), f"expect.torque_saturated_fraction={expected}")
    mission = override(override(mission, "expect.reached=false"), "expect.reference_error_max_m=9")
    found = judged(mission, *flight(mission, 4.0, torque=1.0))
    missed = [each.name for each in found.expectations if not each.passed]
    assert found.passed is (causes == 0), missed
    assert len(found.causes) == causes


def test_what_never_flew_met_nothing_and_has_no_metrics() -> None:
    mission = load("gust_step")
    none = np.zeros((0, size(PlantRecord))), np.zeros((0, size(Tick)))
    found = judged(mission, *none, ended="", exit_code=3, error="sitl-plant died")
    assert (found.expectations, found.metrics, found.items, found.causes) == ([], {}, [], [])
    assert (found.passed, found.ended, found.exit_code) == (False, "aborted", 3)


@pytest.mark.parametrize(("off_m", "is_missed"), [(0.0, False), (2.0, True)])
def test_a_path_that_was_missed_is_told_when_and_by_how_much(
    tmp_path: Path, off_m: float, is_missed: bool
) -> None:
    (tmp_path / "path.toml").write_text(PATH)
    mission = load(tmp_path / "path.toml")
    plant, fcu = flight(mission, 8.0)
    path = (0, 0), (1, 200), (2, 300)  # take-off, to its begin, along it
    places = Vec3(0.0, 0.0, 3.0), Vec3(0.0, 0.0, 3.0), Vec3(5.0, 0.0, 3.0)
    begun = tuple(Begun(*leg, place) for leg, place in zip(path, places, strict=True))
    put(plant, PlantRecord, "state.r_E", timeline(mission.flight, begun).positions_at(plant[:, 0]))
    plant[600:, columns(PlantRecord).index("state.r_E.y")] += off_m
    plant[600, columns(PlantRecord).index("state.r_E.y")] *= 1.25
    found = judged(mission, plant, fcu, begun=begun, ended="done")
    (line,) = [each for each in found.expectations if "along its path" in each.text]
    assert line.passed is not is_missed
    if is_missed:
        assert line.why == "of item 2 (follow): greatest 4 s after its begin, 2.5 m; 2 m in the end"
    else:
        assert line.why is None
