"""Any finite number in any numeric key of a mission: it is rejected in words, or it flies to a result."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fcu.interface.airframe import AirframeError
from fcu.interface.parameter import ParameterError
from fcu.kernel.buffers import to_buffer
from gcs_tools.exit_codes import OK
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.processes import InfrastructureError
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.preflight_check import refusal
from gcs_tools.judging.result import judge
from gcs_tools.missions.fields import MOST
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.mission import MissionError, from_tables
from gcs_tools.missions.tables import Gust, Plant, Wind

NUMBERS = (1e308, -1e308, 1e-308, MOST, -MOST)
ZERO = [0.0, 0.0, 0.0]
FLIGHT = {
    "duration_s": 0.02, "rate_hz": 500, "seed": 3, "ground_z_m": -10.0, "arena_m": 100.0,
    "start": {"position_m": ZERO, "velocity_m_s": ZERO, "yaw_deg": 0.0}, "stream_hz": 20,
    "yaw_deg": 0.0, "yaw": {"amplitude_rad": 0.1, "frequency_rad_s": 1.0},
    "arrive": {"within_m": 0.1, "for_s": 0.01},
    "setpoints": [{"at_s": 0.0, "position_m": ZERO}],
}  # fmt: skip
CURVE = {"kind": "figure_eight", "centre_m": ZERO, "size_m": [5.0, 3.0], "ramp_s": 5.0}
ITEMS = [
    {"kind": "take_off", "height_m": 2.0, "within_m": 0.3, "expect": {"took_s": 10.0}},
    {"kind": "go_to", "position_m": [1.0, 0.0, 2.0], "yaw_deg": 0.0, "within_m": 0.3},
    {
        "kind": "follow", "points_m": [[1.0, 0.0, 2.0], [3.0, 3.0, 2.0]], "corner_m": 0.5,
        "speed_m_s": 3.0, "acceleration_m_s2": 2.0, "smooth_m": 0.0, "yaw_deg": 0.0, "within_m": 0.3,
    },
    {"kind": "hold", "for_s": 1.0},
]  # fmt: skip
SCRIPT = {"script": "python -c pass", "pace": "speed:2", "after_script_s": 1.0}
PLANT = {
    "mass_kg": 8.0, "inertia_kg_m2": [0.2, 0.2, 0.3], "drag": [0.1, 0.1, 0.1],
    "drag_torque": ZERO, "rotor_lag_s": 0.02, "battery_ah": 10.0, "battery_remaining": 0.9,
    "delay_s": 0.002, "mass_change": {"at_s": 0.01, "mass_kg": 7.0},
    "rotor_loss": [{"rotor": 1, "at_s": 0.01, "effectiveness": 0.9}],
    "noise": {"position_m": 0.01, "velocity_m_s": 0.0, "attitude_deg": 0.1, "rate_rad_s": 0.0},
    "faults": [
        {"kind": "motor_weak", "at_s": 0.0, "for_s": 0.01, "rotor": 2, "effectiveness": 0.9},
        {
            "kind": "state_noisy", "at_s": 0.004,
            "noise": {"position_m": 0.01, "velocity_m_s": 0.0, "attitude_deg": 0.1, "rate_rad_s": 0.0},
        },
        {"kind": "state_delayed", "at_s": 0.01, "delay_s": 0.004},
        {"kind": "state_jumps", "at_s": 0.01, "jump_m": [1.0, 0.0, 0.0]},
        {"kind": "battery_drain", "at_s": 0.01, "drain_a": 10.0},
        {"kind": "battery_level", "at_s": 0.01, "remaining": 0.5},
    ],
}  # fmt: skip
WIND = {
    "steady_m_s": ZERO, "amplitude_m_s": ZERO, "frequency_rad_s": ZERO, "phase_rad": ZERO,
    "rotation_amplitude_rad_s": ZERO, "rotation_frequency_rad_s": ZERO, "rotation_phase_rad": ZERO,
    "step_m_s": ZERO, "step_at_s": 0.01, "azimuth_deg": 0.0,
    "shear": "log", "shear_height_m": 10.0, "roughness_m": 0.1, "shear_exponent": 0.14,
    "turbulence": "von_karman", "turbulence_w20_m_s": 7.7,
    "gusts": [{"at_s": 0.004, "velocity_m_s": ZERO, "rise_s": 0.01, "hold_s": 0.01, "fall_s": 0.01}],
}  # fmt: skip
EXPECT = {"reached": 0.5, "setpoint_error_max_m": {"limit": 1.0, "from": 0.0, "to": 0.01}}


def _mission(*without: str, flight: dict[str, Any] | None = None, **tables: Any) -> dict[str, Any]:
    kept = {key: value for key, value in FLIGHT.items() if key not in without}
    return {"title": "Any number.", "flight": {**kept, **(flight or {})}, **tables}


def _law() -> dict[str, Any]:
    """Every number that the law of the paper is told, as it is in force."""
    table: dict[str, Any] = {}
    for key, each in from_tables("x", _mission()).values_in_force().items():
        if key.startswith("law.") and not isinstance(each.value, str | bool):
            *above, last = key.split(".")[1:]
            inner = table
            for name in above:
                inner = inner.setdefault(name, {})
            inner[last] = each.value
    return table


MISSIONS = {
    "plant": _mission(plant=PLANT),
    "wind": _mission(wind=WIND, expect=EXPECT),
    "speed": _mission(
        "setpoints", "arrive", "yaw", flight={"curve": {**CURVE, "speed_max_m_s": 2.0}},
        plant={"mass_change": {"at_s": 0.01, "mass_ratio": 0.9}},
    ),
    "period": _mission("setpoints", "arrive", "yaw", flight={"curve": {**CURVE, "period_s": 10.0}}),
    "items": _mission(
        "setpoints", "arrive", "yaw",
        flight={"duration_s": 60.0, "start": {"on_ground": True}, "ground_z_m": 0.0, "items": ITEMS},
    ),
    "script": _mission("setpoints", "arrive", "yaw", "yaw_deg", flight=SCRIPT),
    "law": _mission(law=_law()),
}  # fmt: skip


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The ways to every number; of an array of them, to its first."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _places(each, (*path, key))
    elif isinstance(value, list | tuple):
        is_vector = value and isinstance(value[0], int | float)
        for i, each in enumerate(value[:1] if is_vector else value):
            yield from _places(each, (*path, i))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


def _with(tables: dict[str, Any], path: tuple[Any, ...], number: float) -> dict[str, Any]:
    changed = copy.deepcopy(tables)
    at: Any = changed
    for step in path[:-1]:
        at[step] = list(at[step]) if isinstance(at[step], tuple) else at[step]
        at = at[step]
    at[path[-1]] = number
    return changed


def _flown(tables: dict[str, Any], folder: Path) -> bool:
    """Fly it and write its result: whether it was not rejected, in words, before."""
    try:
        mission = from_tables("x", tables)
        scene = scenario(mission)
    except (MissionError, ParameterError, AirframeError):
        return False
    assert np.isfinite(to_buffer(scene.world)).all()  # it is handed over as JSON
    if scene.legs or scene.script or refusal(scene, False):
        return True  # items take too long here: what is foreseen of them is finite
    try:
        flown = MemoryFlight(scene, None, (lambda rows: None,) * 2).fly()
    except InfrastructureError as error:
        if "battery at 0 %" not in str(error):
            raise
        return True  # the vehicle does not arm
    result = judge(
        mission, scene.rate_hz, flown.plant, flown.fcu, ended=flown.ended, exit_code=OK, error=None,
        begun=flown.begun, refusal=flown.refusal, wall_time_s=0.0, startup_s=0.0, slips=0, versions={},
    )  # fmt: skip
    result.write(folder / "result.json")
    return True


def _own(name: str) -> list[tuple[Any, ...]]:
    """The numbers that no mission before it has."""
    names = list(MISSIONS)
    before = {path for each in names[: names.index(name)] for path in _places(MISSIONS[each])}
    return [path for path in _places(MISSIONS[name]) if path not in before]


def test_no_key_is_left_out():
    assert PLANT.keys() == Plant.model_fields.keys()
    # `base` has no number. Tests of wind files change those in `file`. `field` needs a packed one
    assert {*WIND, "base", "file", "field"} == Wind.model_fields.keys()
    assert WIND["gusts"][0].keys() == Gust.model_fields.keys()
    # a plan is a file of its own: tests of plan files change the numbers in it
    others = {"curve", "items", "plan", *SCRIPT}
    assert FLIGHT.keys() | others == Flight.model_fields.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", MISSIONS)
def test_any_number_is_rejected_in_words_or_flown_to_a_result(name, tmp_path):
    tables = MISSIONS[name]
    assert _flown(tables, tmp_path)
    for path in _own(name):
        for number in NUMBERS:
            _flown(_with(tables, path, number), tmp_path)
