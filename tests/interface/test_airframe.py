"""The airframe file: what may stand in it, and what is said of one that cannot be flown."""

from __future__ import annotations

import copy
import math

import pytest

from fcu.interface.airframe import (
    OCTO,
    SHIPPED,
    AirframeError,
    airframe,
    believed,
    checked,
    find,
    full_thrust,
    load,
    read,
)

QUAD = {
    "vehicle": {"mass_kg": [1.4, 1.6], "inertia_kg_m2": [[0.01, 0.02]] * 3},
    "rotors": {
        "position_m": [[0.18, -0.18], [-0.18, 0.18], [0.18, 0.18], [-0.18, -0.18]],
        "spin": [1, 1, -1, -1],
        "thrust_coefficient": 1e-5,
        "torque_to_thrust_m": 0.016,
        "full_speed_rad_s": 1000.0,
        "lag_s": 0.03,
        "inertia_kg_m2": 1e-5,
    },
    "limits": {"thrust_min_n": 2.0, "thrust_max_n": 40.0, "tilt_max_deg": 45.0},
    "air": {"drag": [0.05, 0.05, 0.05]},
    "battery": {"cells": 4, "capacity_mah": 5000.0},
}
NOTHING = object()


def other(table, key, value):
    """The tables of QUAD with one key changed, or left out."""
    tables = copy.deepcopy(QUAD)
    if value is NOTHING:
        del tables[table][key]
    else:
        tables.setdefault(table, {})[key] = value
    return tables


def test_a_vehicle_of_four_rotors_has_four_of_eight_columns():
    made, tables = checked(QUAD, "quad.toml")
    assert made.n == 4
    assert made.spin[4:] == made.c_T[4:] == made.Omega_max[4:] == made.x[4:] == (0.0,) * 4
    assert made.x[:4] == (0.18, -0.18, 0.18, -0.18)
    assert full_thrust(made) == pytest.approx(40.0)
    assert tables["mavlink"] == {"type": 2, "autostart": 4001}


@pytest.mark.parametrize(("n", "kind"), [(4, 2), (5, 43), (6, 13), (7, 43), (8, 14)])
def test_the_type_follows_from_the_number_of_rotors_unless_it_is_said(n, kind):
    angles = [360.0 * (i + 0.5) / n for i in range(n)]
    rotors = {"angle_deg": angles, "radius_m": 0.3, "spin": [1, -1] * (n // 2) + [1] * (n % 2)}
    table = {key: value for key, value in QUAD["rotors"].items() if key != "position_m"}
    tables = {**QUAD, "rotors": {**table, **rotors}}
    assert checked(tables, "n.toml")[1]["mavlink"]["type"] == kind
    said = {**tables, "mavlink": {"type": 35}}
    assert checked(said, "n.toml")[1]["mavlink"]["type"] == 35


def test_angles_and_radius_are_places():
    octo = load(OCTO)["rotors"]
    made = airframe(octo)
    places = [list(place) for place in zip(made.x, made.y, made.z, strict=True)]
    rest = {key: value for key, value in octo.items() if key not in ("angle_deg", "radius_m")}
    assert airframe({**rest, "position_m": places}) == made


ENDLESS, NAN = 1e308, math.nan


@pytest.mark.parametrize(("table", "key", "value", "said"), [
    ("rotors", "spin", [1, -1, 1], ["4 to 8", "[1, -1, 1]"]),
    ("rotors", "spin", [1, -1] * 4 + [1], ["4 to 8"]),
    ("rotors", "spin", [1, -1, 2, -1], ["counter-clockwise"]),
    ("rotors", "spin", [1, -1, NAN, -1], ["counter-clockwise"]),
    ("rotors", "spin", "ccw", ["4 to 8", '"ccw"']),
    ("rotors", "spin", [1, 1, 1, 1], ["thrust and torque about yaw go together"]),
    ("rotors", "spin", [1, -1, 1, -1], ["torque about pitch and torque about yaw go together"]),
    ("rotors", "position_m", [[0.1, 0.0]] * 4, ["apart from the others"]),
    ("rotors", "position_m", [[0.3, 0.0], [0.1, 0.0], [-0.1, 0.0], [-0.3, 0.0]],
     ["no torque about roll"]),
    ("rotors", "position_m", [[0.5, -0.2], [0.1, 0.2], [0.5, 0.2], [0.1, -0.2]], ["rotor"]),
    ("rotors", "position_m", [[0.1, 0.1]] * 3, ["4 places", "[x, y, z]"]),
    ("rotors", "position_m", [[0.1, ENDLESS]] * 4, ["-20 to 20 m", "1e+308"]),
    ("rotors", "position_m", [[[[0.1]]]] * 4, ["[x, y, z]"]),
    ("rotors", "position_m", [[NAN, 0.1]] * 4, ["nan"]),
    ("rotors", "radius_m", 0.3, ["either position_m, or angle_deg and radius_m"]),
    ("rotors", "position_m", NOTHING, ["angle_deg is missing", "position_m"]),
    ("rotors", "thrust_coefficient", [1e-5] * 3, ["4 of them"]),
    ("rotors", "thrust_coefficient", -1e-5, ["1e-12 to 1"]),
    ("rotors", "thrust_coefficient", True, ["true"]),
    ("rotors", "full_speed_rad_s", ENDLESS, ["1 to 100000 rad/s"]),
    ("rotors", "torque_to_thrust_m", 0.0, ["1e-06 to 1 m"]),
    ("rotors", "torque_to_thrust_m", [0.01] * 4, ["a number"]),
    ("rotors", "lag_s", "slow", ['"slow"']),
    ("rotors", "lag_s", NOTHING, ["lag_s is missing"]),
    ("rotors", "lags", 0.03, ["no such key", "lag_s"]),
    ("vehicle", "mass_kg", 1.5, ["[least, greatest]", "1.5"]),
    ("vehicle", "mass_kg", [1.6, 1.4], ["[least, greatest]"]),
    ("vehicle", "mass_kg", [1.4, 4.0], ["cannot hover", "the rotors give 40 N", "47.1 N"]),
    ("vehicle", "inertia_kg_m2", [0.01, 0.01, 0.02], ["three of [least, greatest]"]),
    ("limits", "thrust_max_n", 18.0, ["cannot hover", "[limits] thrust_max_n give 18 N"]),
    ("limits", "thrust_min_n", 40.0, ["less than thrust_max_n"]),
    ("limits", "tilt_max_deg", 90.0, ["1 to 89 deg"]),
    ("air", "drag", [0.1, 0.1], ["three numbers"]),
    ("air", "drag", [0.1, 0.1, -0.1], ["above 0"]),
    ("battery", "cells", NAN, ["1 to 100", "nan"]),
    ("mavlink", "type", 2.5, ["whole number"]),
    ("mavlink", "type", NAN, ["whole number"]),
    ("engines", "count", 4, ["no such table"]),
])  # fmt: skip
def test_what_cannot_be_flown_is_said_with_table_and_key(table, key, value, said):
    with pytest.raises(AirframeError) as error:
        checked(other(table, key, value), "mine.toml")
    text = str(error.value)
    assert text.startswith("mine.toml: ")
    assert "\n" not in text
    assert all(part in text for part in said)


def test_an_error_names_its_line(tmp_path):
    file = tmp_path / "mine.toml"
    text = OCTO.read_text()
    file.write_text(text.replace("lag_s = 0.05", "lag_s = -1"))
    line = 1 + text.splitlines().index(next(s for s in text.splitlines() if s.startswith("lag_s")))
    with pytest.raises(AirframeError, match=rf"mine\.toml:{line}: \[rotors\] lag_s: expected"):
        read(file)


def test_a_name_is_a_shipped_airframe_and_a_file_is_relative_to_a_folder(tmp_path):
    assert find("s1000") == OCTO == SHIPPED["s1000"]
    assert find("mine.toml", tmp_path) == tmp_path / "mine.toml"
    with pytest.raises(AirframeError, match="did you mean s1000"):
        find("s100")
    with pytest.raises(AirframeError, match="No such file"):
        believed(find("mine.toml", tmp_path))


def test_a_copy_of_a_shipped_file_is_known_by_its_text_not_by_its_name(tmp_path):
    copied = tmp_path / "s1000.toml"
    copied.write_text(OCTO.read_text())
    file, shipped = read(copied), read()
    assert file.sha256 == shipped.sha256
    assert (shipped.source, file.source) == ("s1000", str(copied))
    assert file.rotors == shipped.rotors
