"""The numbers of each figure, against ones computed by hand."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gcs_tools.pictures.plot import estimates, limits, overview, prediction, timing, tracking, wind
from gcs_tools.pictures.plot.numbers import length, percent, short
from gcs_tools.pictures.plot.window import Missing, Window
from gcs_tools.recording.reader import VALUES


def all_of(made: Any, t_from: float | None = None, t_to: float | None = None) -> Window:
    return Window.of(made.recording(), t_from, t_to)


def test_tracking_is_the_distance_from_the_reference(made: Any) -> None:
    off = np.where(made.t < 2.0, 1.0, 0.01)  # m along (3, 4, 0) / 5
    made.set_plant(**{"state.r_E.x": 0.6 * off, "state.r_E.y": 0.8 * off})
    made.set_plant(**{"state.r_E.z": np.where(made.t == 1.0, 2.4, 0.0)})
    found = tracking.numbers(all_of(made))
    assert found["reference_error_rms_settled_m"] == pytest.approx(0.01)
    assert found["reference_error_max_m"] == pytest.approx(2.6)
    assert found["reference_error_max_at_s"] == 1.0
    assert tracking.answer(found) == (
        "settled RMS 1 cm off the reference, worst 2.6 m at 1 s; at the end 1 cm off the setpoint"
    )
    assert "never settled" in tracking.answer(tracking.numbers(all_of(made, 0.0, 4.0)))


def test_the_setpoint_is_the_one_that_the_mission_asked_for(made: Any) -> None:
    """As its metadata have it, not as the vehicle limited it."""
    made.set_fcu(**{"setpoint.r_c.x": 100.0})
    assert tracking.numbers(all_of(made))["setpoint_error_final_m"] == pytest.approx(100.0)
    asked = {
        "flight.duration_s": 8.0,
        "flight.setpoints": [{"at_s": 0.0, "position_m": [1000.0, 0.0, 0.0]}],
    }
    values = {key: {"value": value, "origin": "mission"} for key, value in asked.items()}
    made.metadata[VALUES] = json.dumps(values)
    assert tracking.numbers(all_of(made))["setpoint_error_final_m"] == pytest.approx(1000.0)


def test_the_overview_says_from_what_it_measures(made: Any) -> None:
    made.set_plant(**{"state.r_E.x": 0.01})
    made.set_fcu(**{"setpoint.r_c.x": 4.01})
    said = overview.answer(overview.numbers(all_of(made)))
    assert said.startswith("settled RMS 1 cm off the reference, at the end 4 m off the setpoint, ")


def test_room_is_what_is_left_before_the_nearer_limit(made: Any) -> None:
    """Limits of thrust are 5 and 200 N, of tilt 45 degrees, of a rotor 0.625 and 25 N."""
    made.set_fcu(**{"outputs.T_c": np.where(made.t < 1.0, 24.5, 100.0)})
    made.set_fcu(**{"outputs.angles_c.x": np.radians(-36.0)})
    made.set_fcu(**{"outputs.angles_c.y": np.radians(9.0)})
    made.set_fcu(**{"outputs.saturation.torque": made.t < 2.0})
    found = limits.numbers(all_of(made))
    assert found["thrust_room_fraction"] == pytest.approx(0.1)
    assert found["tilt_room_fraction"] == pytest.approx(0.2)
    assert found["rotor_room_fraction"] == pytest.approx(
        (10.0 - 0.625) / (made.told["law.rotors.f_max"] - 0.625)
    )
    assert found["tilt_max_deg"] == pytest.approx(36.0)
    assert found["rotor_saturated_fraction"] == 0.25
    made.set_fcu(**{"guard.margin.force": np.where(made.t == 1.0, -3.0, 40.0)})
    made.set_fcu(**{"guard.governed": made.t < 2.0})
    margins = limits.numbers(all_of(made))
    assert (margins["margin_min_n"], margins["governed_fraction"]) == (-3.0, 0.25)
    assert limits.answer(found) == (
        "thrust never at a limit (10 % of its range left), "
        "tilt never at a limit (20 % of its range left), rotors at a limit 25 % of the time"
    )


def test_a_rotor_that_is_lost_leaves_the_room_of_the_others(made: Any) -> None:
    before = limits.numbers(all_of(made))["rotor_room_fraction"]
    made.set_fcu(**{"outputs.thrusts.r1": np.where(made.t < 2.0, 10.0, 0.0)})
    assert limits.numbers(all_of(made))["rotor_room_fraction"] == before


def test_prediction_errors_are_norms_once_settled(made: Any) -> None:
    early = made.t < 5.0
    made.set_fcu(**{"internals.prediction.v_til.x": np.where(early, 0.3, 0.003)})
    made.set_fcu(**{"internals.prediction.v_til.z": np.where(early, -0.4, -0.004)})
    made.set_fcu(**{"internals.prediction.w_til.y": np.where(early, 0.5, 0.002)})
    made.set_fcu(**{"internals.flags.projected": made.t < 0.8})
    found = prediction.numbers(all_of(made))
    assert found["velocity_rms_settled_m_s"] == pytest.approx(0.005)
    assert found["velocity_max_m_s"] == pytest.approx(0.5)
    assert found["rate_rms_settled_rad_s"] == pytest.approx(0.002)
    assert found["projected_fraction"] == pytest.approx(0.1)
    assert prediction.answer(found).startswith("settled RMS 5 mm/s and 2 mrad/s")


def test_estimates_are_held_against_their_truth(made: Any) -> None:
    made.set_fcu(**{"state.estimates.m_hat": 7.0, "state.estimates.J_hat.z": 0.25})
    made.set_plant(**{"f_D_E.x": 8.0})  # over 8 kg: 1 m/s^2
    made.set_fcu(
        **{
            "state.estimates.s_v_hat.x": 1.3,
            "state.estimates.s_v_hat.y": -0.4,
            "state.estimates.s_v_hat.z": 9.0,
        }
    )
    found = estimates.numbers(all_of(made))
    assert found["mass_error_final_kg"] == -1.0
    assert found["mass_error_final_fraction"] == -0.125
    assert found["inertia_error_final_fraction"] == -0.5  # z; x and y are a third too high
    assert found["drag_across_rms_settled_m_s2"] == pytest.approx(0.5)
    assert found["drag_rms_settled_m_s2"] == pytest.approx(np.hypot(0.5, 9.0))
    assert "mass -12.5 %, inertia -50.0 % (worst axis)" in estimates.answer(found)


def test_as_printed_the_estimate_holds_gravity(made: Any) -> None:
    made.set_fcu(**{"state.estimates.s_v_hat.z": -9.81})
    achieved = estimates.estimated(all_of(made), "Drag over mass")[2].truth
    made.told["law.achieved"] = 0.0
    printed = estimates.estimated(all_of(made), "Drag over mass")[2].truth
    assert achieved is not None and printed is not None
    assert (achieved == 0.0).all() and (printed == -9.81).all()


def test_the_angular_truth_is_torque_over_inertia(made: Any) -> None:
    """Air: -0.05 * 2 * |2| = -0.2 N m about x. A rotor in front on the left a newton weak."""
    made.set_plant(**{"state.w_B.x": 1.5, "w_air_B.x": -0.5})
    Omega = np.sqrt(10.0 / made.told["law.rotors.c_T.r1"])
    made.set_plant(**{f"state.Omega.r{i}": Omega for i in range(1, 9)})
    x, y, spin = (made.told[f"law.rotors.{of}.r1"] for of in ("x", "y", "spin"))
    assert x > 0.0 and y > 0.0
    lost = {"x": -y, "y": x, "z": made.told["law.rotors.k_Q"] * spin}
    made.set_plant(**{f"tau_B.{axis}": torque for axis, torque in lost.items()})
    p, q, r = (e.truth for e in estimates.angular(all_of(made)))
    assert p == pytest.approx((-0.2 - y) / 0.3)
    assert q == pytest.approx(x / 0.3)
    assert r == pytest.approx(made.told["law.rotors.k_Q"] * spin / 0.5)


def test_the_angular_truth_is_unknown_on_the_ground_and_without_the_coefficient(made: Any) -> None:
    made.set_plant(on_ground=made.t < 1.0)
    p = estimates.angular(all_of(made))[0].truth
    assert p is not None
    assert np.isnan(p[made.t < 1.0]).all() and (p[made.t >= 1.0] == 0.0).all()
    del made.metadata[VALUES]
    window = all_of(made)
    assert all(e.truth is None for e in estimates.angular(window))
    assert estimates.numbers(window)["angular_rms_settled_rad_s2"] is None
    assert any("No truth for ŝ_ω" in said for said in estimates.notes(window))


def test_couplings_follow_from_inertia(made: Any) -> None:
    made.set_plant(**{"J.x": 0.2, "J.y": 0.4, "J.z": 0.5})
    truths = [e.truth for e in estimates.couplings(all_of(made))]
    for truth, by_hand in zip(truths, (-0.5, 0.75, -0.4), strict=False):
        assert truth == pytest.approx(by_hand)
    assert truths[3:] == [None, None]


def test_wind_counts_from_a_second_after_take_over(made: Any) -> None:
    made.set_fcu(engaged=np.where(made.t < 2.0, 0.0, 2.0))
    east = np.where(made.t < 2.0, np.nan, np.where(made.t < 3.0, 90.0, 5.3))
    made.set_plant(**{"v_air_E.x": 5.0, "v_air_E.y": -2.0, "v_air_E.z": 7.0})
    made.set_fcu(**{"wind.v_air_E.x": east, "wind.v_air_E.y": np.where(made.t < 2.0, np.nan, -1.6)})
    made.set_fcu(**{"wind.v_air_E.z": np.nan})
    found = wind.numbers(all_of(made))
    assert found["from_s"] == 3.0
    assert found["east_rms_m_s"] == pytest.approx(0.3)
    assert found["north_rms_m_s"] == pytest.approx(0.4)
    assert found["horizontal_rms_m_s"] == pytest.approx(0.5)
    assert found["true_max_m_s"] == pytest.approx(np.hypot(5.0, 2.0))
    assert wind.numbers(all_of(made, 5.0))["from_s"] == 5.0
    assert wind.numbers(all_of(made, 2.0, 2.5))["horizontal_rms_m_s"] is None  # nothing counts


def test_wind_is_compared_at_ticks_that_both_have(made: Any) -> None:
    made.set_plant(**{"v_air_E.x": made.t})
    made.set_fcu(**{"wind.v_air_E.x": made.t})
    recording = made.recording()
    recording.reports["/fcu/wind"] = recording.reports["/fcu/wind"].take(slice(100, None, 3))
    found = wind.numbers(Window.of(recording, None, None))
    assert found["from_s"] == pytest.approx(1.0)
    assert found["horizontal_rms_m_s"] == pytest.approx(0.0, abs=1e-12)


def test_timing_counts_within_the_window(made: Any) -> None:
    made.set_fcu(**{"timing.cycle": np.where(made.t == 3.0, 900e-6, 40e-6)})
    made.set_fcu(**{"timing.unpublished": np.floor(made.t)})
    made.set_plant(**{"timing.late": 5e-6, "timing.published": 2.0 * made.t})
    made.set_plant(**{"timing.slips": np.floor(2.0 * made.t), "timing.unrecorded": 100.0})
    found = timing.numbers(all_of(made))
    assert found["cycle_median_us"] == pytest.approx(40.0)
    assert found["cycle_max_us"] == pytest.approx(900.0)
    assert found["late_p99_us"] == pytest.approx(5.0)
    assert found["period_us"] == pytest.approx(4000.0)  # paced at half of real time
    assert (found["slips"], found["rows_dropped"]) == (15.0, 107.0)
    later = timing.numbers(all_of(made, 4.0, 6.0))
    assert later["cycle_max_us"] == pytest.approx(40.0)
    assert (later["slips"], later["rows_dropped"]) == (12.0 - 7.0, 6.0 - 3.0)


def test_full_speed_has_no_lateness(made: Any) -> None:
    made.set_plant(**{"timing.late": np.nan})
    window = all_of(made)
    found = timing.numbers(window)
    assert found["late_max_us"] is None
    assert found["period_us"] == pytest.approx(2000.0)
    assert "without deadlines" in timing.answer(found)
    assert any("full speed" in said for said in timing.notes(window))


def test_a_flight_that_is_not_finite_has_no_value(made: Any) -> None:
    made.set_plant(**{"state.r_E.x": np.where(made.t > 6.0, np.inf, 0.0)})
    made.set_fcu(
        **{
            "internals.prediction.v_til.x": np.nan,
            "outputs.T_c": np.inf,
            "state.estimates.m_hat": np.nan,
        }
    )
    window = all_of(made)
    assert tracking.numbers(window)["reference_error_rms_settled_m"] is None
    assert prediction.numbers(window)["velocity_rms_settled_m_s"] is None
    assert limits.numbers(window)["thrust_room_fraction"] is None
    found = estimates.numbers(window)
    assert found["mass_error_final_kg"] is None
    assert "mass no value" in estimates.answer(found)


@pytest.mark.parametrize("module", [tracking, limits, prediction, estimates, wind])
def test_a_law_that_never_flew_shows_nothing(made: Any, module: Any) -> None:
    made.set_fcu(engaged=0.0)
    with pytest.raises(Missing, match="not flying"):
        module.numbers(all_of(made))


@pytest.mark.parametrize(
    ("module", "changed", "why"),
    [
        (wind, {"reports": {}}, "/fcu/wind is not in the recording"),
        (timing, {"reports": {}}, "a flight in one process has no timing"),
        (limits, {"params": None}, "/fcu/params"),
        (estimates, {"params": None}, "/fcu/params"),
    ],
)
def test_what_is_missing_is_named(made: Any, module: Any, changed: Any, why: str) -> None:
    with pytest.raises(Missing, match=why):
        module.numbers(Window.of(made.recording(**changed), None, None))


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (length(0.0006), "0.6 mm"), (length(0.0211), "2.1 cm"), (length(0.996), "0.996 m"),
        (length(1234.4), "1234 m"), (length(None), "no value"),
        (percent(0.0), "0 %"), (percent(1e-4), "below 0.1 %"), (percent(0.0116), "1.16 %"),
        (short(4737.2), "4737"), (short(0.0101), "0.0101"), (short(1.5e7), "1.5e+07"),
    ],
)  # fmt: skip
def test_numbers_are_said_in_words_a_person_would_use(said: str, words: str) -> None:
    assert said == words


def test_a_window_keeps_what_counts_as_settled(make: Callable[..., Any]) -> None:
    """Settled is five seconds after the last step of the whole flight, at 3 s here."""
    made = make(12.0)
    made.set_fcu(**{"setpoint.r_c.x": np.where(made.t < 3.0, 0.0, 1.0)})
    window = all_of(made, 6.0, 10.0)
    assert (window.t[0], window.t[-1]) == (6.0, 10.0)
    assert window.settled_from_s == 8.0
    assert all_of(made, 1.0, 4.0).settled_from_s == 1.0  # nothing is settled: all of it
