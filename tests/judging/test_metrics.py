"""The metrics on flights of which the numbers are plain to see."""

import math
from typing import Any

import numpy as np
import pytest

from fcu.kernel.buffers import columns, size
from fcu.process.tick import Tick
from gcs_tools.judging.metrics import (
    BOUNCE_S,
    METRICS,
    EngagedTicks,
    metric,
    metrics,
    on_ground,
    settle_from,
)
from gcs_tools.recording.table import Rows, Table
from sitl_plant.physics.types import PlantRecord

RATE = 10.0  # Hz
OFF = [2.0, 3.0, 6.0]  # 7 m long


def put(rows: Rows, cls: Any, name: str, value: Any, ticks: Any = slice(None)) -> None:
    """Set a column, or the columns of a vector, at some ticks."""
    names = columns(cls)
    at = [i for i, column in enumerate(names) if column == name or column.startswith(f"{name}.")]
    rows[ticks, at[0] : at[-1] + 1] = value


def flight(seconds: float) -> tuple[Rows, Rows]:
    """A flight at RATE that takes over at 0 and stays at the origin, setpoint and all."""
    n = round(seconds * RATE) + 1
    plant, fcu = np.zeros((n, size(PlantRecord))), np.zeros((n, size(Tick)))
    plant[:, 0] = np.arange(n) / RATE
    put(fcu, Tick, "t", plant[:, :1])
    put(fcu, Tick, "engaged", 2.0)
    put(fcu, Tick, "engaged", 1.0, 0)
    return plant, fcu


def told(plant: Rows, fcu: Rows) -> tuple[Table, Table]:
    """What it is judged by."""
    return Table.of(PlantRecord, plant), Table.of(Tick, fcu)


def test_errors_are_distances() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", OFF)
    put(fcu, Tick, "setpoint.r_c", [2.0, 0.0, 2.0])  # off by (0, 3, 4): 5 m
    found = metrics(*told(plant, fcu))
    assert set(found) == set(METRICS)
    for name in (
        "reference_error_rms_m",
        "reference_error_rms_settled_m",
        "reference_error_max_m",
        "reference_error_final_m",
    ):
        assert found[name] == pytest.approx(7.0)
    for name in ("rms", "rms_settled", "max", "final"):
        assert found[f"setpoint_error_{name}_m"] == pytest.approx(5.0)
    assert found["nonfinite_samples"] == 0.0


def test_the_setpoint_error_is_from_what_was_asked_for() -> None:
    """Not from what the vehicle made of it: the setpoint it flew lies nearer here."""
    plant, fcu = flight(20.0)
    put(fcu, Tick, "setpoint.r_c", [100.0, 0.0, 0.0])
    put(plant, PlantRecord, "state.r_E", [40.0, 0.0, 0.0])
    asked = EngagedTicks.of(*told(plant, fcu), asked=lambda t: np.outer(t, [50.0, 0.0, 0.0]))
    found = asked.metrics()
    assert found["setpoint_error_final_m"] == pytest.approx(1000.0 - 40.0)
    assert found["setpoint_error_max_m"] == pytest.approx(1000.0 - 40.0)
    assert asked.metric("setpoint_error_max_m", 0.0, 0.0) == pytest.approx(40.0)


def test_root_of_the_mean_square() -> None:
    plant, fcu = flight(0.3)  # four ticks: 1, 1, 1 and 5 m
    put(plant, PlantRecord, "state.r_E", [[1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 3, 4]])
    assert metrics(*told(plant, fcu))["reference_error_rms_m"] == pytest.approx(math.sqrt(7.0))


def test_settled_begins_five_seconds_after_take_over() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "engaged", 0.0, slice(0, 20))  # idle for two seconds
    put(fcu, Tick, "engaged", 1.0, 20)
    put(plant, PlantRecord, "state.r_E", OFF, slice(0, 70))  # up to 6.9 s
    assert settle_from(told(plant, fcu)[1]) == 7.0
    found = metrics(*told(plant, fcu))
    assert found["reference_error_rms_settled_m"] == 0.0
    assert found["reference_error_rms_m"] == pytest.approx(
        7.0 * math.sqrt(50 / 181)
    )  # idle ticks apart


def test_settled_begins_five_seconds_after_the_last_step() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "setpoint.r_c", [0.0, 0.0, 1.0], slice(40, None))
    put(fcu, Tick, "setpoint.r_c", [4.0, 7.0, 18.0], slice(90, None))  # at 9 s
    assert settle_from(told(plant, fcu)[1]) == 14.0


def test_a_moving_setpoint_makes_no_step() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "setpoint.r_c", fcu[:, :1] * [[1.0, 0.0, 0.0]])
    put(fcu, Tick, "setpoint.v_c", [1.0, 0.0, 0.0])
    assert settle_from(told(plant, fcu)[1]) == 5.0


def test_a_place_after_a_velocity_is_a_step_unless_it_is_where_that_led() -> None:
    plant, fcu = flight(20.0)
    t = plant[:, 0]
    put(fcu, Tick, "setpoint.v_c", [1.0, 0.0, 0.0], slice(0, 100))
    put(fcu, Tick, "setpoint.r_c.x", np.minimum(t, 10.0)[:, None])
    assert settle_from(told(plant, fcu)[1]) == 5.0
    put(fcu, Tick, "setpoint.r_c.x", 58.0, slice(100, None))
    assert settle_from(told(plant, fcu)[1]) == 15.0


def test_of_attitudes_there_is_no_setpoint_error() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "setpoint.level", 1.0)
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.metric("setpoint_error_max_m") is None
    assert found.why_no_value("setpoint_error_max_m", None, None) == "no place was asked for"
    put(fcu, Tick, "setpoint.level", 0.0, slice(0, 50))
    put(plant, PlantRecord, "state.r_E", OFF, slice(50, None))
    assert metrics(*told(plant, fcu))["setpoint_error_max_m"] == 0.0


def test_settling_needs_the_mission() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", OFF, slice(0, 150))
    assert metrics(*told(plant, fcu))["reference_error_rms_settled_m"] > 5.0  # type: ignore[operator]
    assert metrics(*told(plant, fcu), settle_from_s=15.0)["reference_error_rms_settled_m"] == 0.0


def test_final_is_the_worst_of_the_last_second() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", [0.0, 0.5, 0.0], 190)  # at 19.0 s, the last that counts
    put(plant, PlantRecord, "state.r_E", [9.0, 0.0, 0.0], 189)
    found = metrics(*told(plant, fcu))
    assert found["reference_error_final_m"] == 0.5
    assert found["reference_error_max_m"] == 9.0


def test_saturation_is_a_part_of_the_flight() -> None:
    plant, fcu = flight(9.9)  # a hundred ticks
    put(fcu, Tick, "outputs.saturation.thrust", 1.0, slice(0, 10))
    put(fcu, Tick, "outputs.saturation.tilt", 1.0, slice(0, 25))
    put(fcu, Tick, "outputs.saturation.torque", 1.0, slice(50, 51))
    put(fcu, Tick, "outputs.saturation.yaw", 1.0, slice(50, 53))
    found = metrics(*told(plant, fcu))
    assert found["thrust_saturated_fraction"] == 0.1
    assert found["tilt_saturated_fraction"] == 0.25
    assert found["torque_saturated_fraction"] == 0.01
    assert found["yaw_saturated_fraction"] == found["rotor_saturated_fraction"] == 0.03
    assert metric("thrust_saturated_fraction", *told(plant, fcu), t_from=1.0) == 0.0
    assert metric("thrust_saturated_fraction", *told(plant, fcu), t_to=0.9) == 1.0


def test_margins_are_the_least_of_the_flight() -> None:
    plant, fcu = flight(9.9)
    put(fcu, Tick, "guard.governed", 1.0, slice(0, 30))
    for name, most in (("force", 50.0), ("tilt", 0.5), ("condition", 9.0)):
        put(fcu, Tick, f"guard.margin.{name}", most)
        put(fcu, Tick, f"guard.margin.{name}", -0.1 * most, 7)
    found = metrics(*told(plant, fcu))
    assert found["governed_fraction"] == 0.3
    assert found["margin_min_n"] == -5.0
    assert found["margin_tilt_min_deg"] == pytest.approx(math.degrees(-0.05))
    assert found["margin_condition_min_n"] == -0.9
    assert metric("margin_min_n", *told(plant, fcu), t_from=1.0) == 50.0


def test_thrust_and_tilt_are_those_commanded() -> None:
    plant, fcu = flight(5.0)
    put(fcu, Tick, "outputs.T_achieved", 300.0)
    put(fcu, Tick, "outputs.T_c", 199.0, 3)
    put(fcu, Tick, "outputs.angles_c", [math.radians(10), math.radians(-45), 3.0], 7)
    found = metrics(*told(plant, fcu))
    assert found["thrust_max_n"] == 199.0
    assert found["tilt_max_deg"] == pytest.approx(45.0)  # yaw is no tilt


def test_a_window_holds_both_its_ends() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", [1.0, 0.0, 0.0], 120)
    put(plant, PlantRecord, "state.r_E", [2.0, 0.0, 0.0], 130)
    put(plant, PlantRecord, "state.r_E", [3.0, 0.0, 0.0], 131)
    assert metric("reference_error_max_m", *told(plant, fcu), 12.0, 13.0) == 2.0
    assert metric("reference_error_max_m", *told(plant, fcu), 12.0, 12.9) == 1.0
    assert metric("reference_error_max_m", *told(plant, fcu), 12.1, 12.9) == 0.0
    assert metric("reference_error_max_m", *told(plant, fcu), 30.0, None) is None


def test_a_diverged_flight_has_finite_metrics() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", [0.0, 0.0, 80.0], 150)
    put(plant, PlantRecord, "state.r_E", [0.0, np.inf, np.nan], slice(198, None))
    found = EngagedTicks.of(*told(plant, fcu)).metrics()
    assert found["reference_error_max_m"] == 80.0
    assert found["nonfinite_samples"] == 3.0
    assert found["reference_error_rms_m"] is None  # no mean square of what is not finite
    assert found["reference_error_final_m"] is None
    assert metric("reference_error_rms_m", *told(plant, fcu), t_to=19.0) == pytest.approx(
        80 / math.sqrt(191)
    )


def test_ticks_of_a_law_that_is_not_finite_are_counted() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "command.u.r3", np.nan, 100)
    put(fcu, Tick, "outputs.thrusts.r8", np.inf, slice(100, 104))
    put(fcu, Tick, "outputs.e_r", np.nan)  # of a reference model, which a law may not have
    assert metrics(*told(plant, fcu))["nonfinite_samples"] == 4.0


@pytest.mark.parametrize("name", ["state.estimates.m_hat", "internals.demand.tau_d.y", "guard_state.beta", "guard.governed"])  # fmt: skip
def test_a_number_that_stops_being_finite_is_named_with_its_time(name: str) -> None:
    plant, fcu = flight(20.0)
    assert EngagedTicks.of(*told(plant, fcu)).first_not_finite() is None
    put(fcu, Tick, name, np.nan, slice(100, 103))
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.metric("nonfinite_samples") == 3.0
    broken = found.first_not_finite()
    assert broken is not None
    assert (broken.time_s, broken.fields) == (fcu[100, 0], [name])


def test_a_state_that_is_not_finite_from_the_first_tick_on_is_named() -> None:
    """The state is what a law goes on from: it has no number there that it may not have."""
    plant, fcu = flight(20.0)
    put(fcu, Tick, "state.estimates.m_hat", np.nan)
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.metric("nonfinite_samples") == len(found.t)
    broken = found.first_not_finite()
    assert broken is not None and broken.fields == ["state.estimates.m_hat"]


def test_a_number_that_a_law_never_tells_is_none_that_it_lost() -> None:
    plant, fcu = flight(20.0)
    put(fcu, Tick, "internals.demand.tau_d", np.nan)
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.first_not_finite() is None
    assert found.metric("nonfinite_samples") == 0.0


def test_a_metric_without_a_value_says_why() -> None:
    plant, fcu = flight(20.0)
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.why_no_value("reference_error_max_m", 30.0) == "no tick after 30 s"
    assert (
        found.why_no_value("reference_error_max_m", 21.0, 22.0) == "no tick after 21 s before 22 s"
    )
    put(plant, PlantRecord, "state.r_E", [0.0, np.inf, np.nan])
    found = EngagedTicks.of(*told(plant, fcu), settle_from_s=25.0)
    assert found.why_no_value("reference_error_rms_m") == "of numbers that are not finite"
    assert (
        found.why_no_value("setpoint_error_rms_settled_m")
        == "the flight counts as settled from 25 s"
    )
    put(fcu, Tick, "outputs.reference.r_m", np.nan)
    found = EngagedTicks.of(*told(plant, fcu))
    assert found.why_no_value("reference_error_rms_m") == "this law has no reference model"
    put(fcu, Tick, "engaged", 0.0)
    assert (
        EngagedTicks.of(*told(plant, fcu)).why_no_value("reference_error_rms_m")
        == "the law never flew"
    )


def test_a_huge_error_does_not_overflow() -> None:
    plant, fcu = flight(20.0)
    put(plant, PlantRecord, "state.r_E", [3e200, 4e200, 0.0])
    assert metrics(*told(plant, fcu))["reference_error_rms_m"] == pytest.approx(5e200)


def test_ticks_are_joined_by_their_time() -> None:
    """The flight controller knows time in whole microseconds, and may have seen fewer ticks."""
    plant, fcu = flight(1.0)
    put(plant, PlantRecord, "state.r_E", plant[:, :1])
    put(fcu, Tick, "outputs.reference.r_m", plant[:, :1])
    plant[:, 0] += 1e-9
    assert metrics(*told(plant, fcu[3:8]))["reference_error_max_m"] == 0.0


def test_a_flight_that_never_flew_has_no_metrics() -> None:
    plant, fcu = flight(1.0)
    put(fcu, Tick, "engaged", 0.0)
    found = metrics(*told(plant, fcu))
    assert found.pop("nonfinite_samples") == 0.0
    assert set(found.values()) == {None}


@pytest.mark.parametrize(("gap_s", "bounced"), [(0.9 * BOUNCE_S, True), (1.1 * BOUNCE_S, False)])
def test_between_two_touches_a_vehicle_that_bounces_counts_as_on_the_ground(gap_s, bounced) -> None:
    plant, _ = flight(1.0)
    plant[:, 0] = 0.5 * gap_s * np.arange(len(plant))
    put(plant, PlantRecord, "on_ground", 1.0, [2, 4])  # a gap apart, in the air between
    found = on_ground(Table.of(PlantRecord, plant))
    assert found.tolist() == [i in (2, 4) or (bounced and i == 3) for i in range(len(plant))]
