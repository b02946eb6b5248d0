"""`gcs airframe`: what it says of an airframe, its codes, its figure."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from fcu.interface.airframe import SHIPPED, read
from gcs_tools.judging.airframe_check import airframe_check
from tests import command_line


def gcs(*arguments):
    return command_line.gcs("airframe", *arguments)


@pytest.fixture
def changed(tmp_path):
    """`changed("quad", ("lag_s = 0.025", "lag_s = 9.0"))`: a file of an airframe with another text."""

    def write(name, *changes):
        text = SHIPPED[name].read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_airframe_flies(name):
    done = gcs(name, "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["flies"] and told["unstable"] == "" and told["grounded"] == ""
    assert [channel["stable"] for channel in told["channels"]] == [True] * 4
    assert 0.0 < told["hover_throttle"] < 1.0 < told["thrust_to_weight"]
    for channel in told["channels"]:
        assert min(channel["gain_down_db"], channel["gain_up_db"]) > 3.0


def test_numbers_of_the_octocopter():
    """Hover on 1170 W, 17 minutes (sitl_plant/README.md); 2.5 rad/s^2 of yaw; 8.9 dB of a gain."""
    told = airframe_check(read())
    assert told.hover_time_s / 60.0 == pytest.approx(17.1, abs=0.1)
    assert told.hover_power_w == pytest.approx(1170.0, rel=0.01)
    assert told.authority[2].acceleration_rad_s2 == pytest.approx(2.53, abs=0.01)
    assert told.rotors[0].hover_thrust_n == pytest.approx(9.81)
    pitch = told.channels[2]
    assert (pitch.name, round(pitch.delay_s, 3)) == ("pitch", 0.018)
    pins = {gain.key: gain for gain in told.gains}
    assert pins["f_m"].pinned and pins["f_m"].value == 2.0
    assert pins["f_m"].follows == pytest.approx(2.041, abs=1e-3)
    assert not pins["rotor_response_s"].pinned


def test_printed_numbers_of_an_airframe(tmp_path):
    done = gcs("x8")
    assert done.exit_code == 0
    for words in ("It flies", "8 rotors", "Authority beside hover", "gain margin", "c_rate"):
        assert words in done.stdout


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_figure_is_drawn(tmp_path, suffix):
    path = tmp_path / f"x8.{suffix}"
    assert gcs("x8", "--figure", path).exit_code == 0
    begins = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(begins)
    if suffix == "svg":
        text = path.read_text()
        assert all(f">{number}<" in text for number in range(1, 9))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ([("mass_kg = [1.4, 1.8]", "mass_kg = [1.4, 2.9]")], "cannot hover"),
        ([("spin = [1, 1, -1, -1]", "spin = [1, 1, 1, 1]")], "yaw"),
        ([("lag_s = 0.025", "lag_s = nan")], "lag_s"),
        ([("[battery]", "[law.mmrac]\nf_mm = 1.0\n[battery]")], "f_mm"),
        ([("[battery]", "[law.mmrac]\nm_hat_0 = 9.0\n[battery]")], "m_hat_0"),
    ],
)
def test_what_cannot_fly_is_rejected_with_the_reason(changed, changes, says):
    done = gcs(changed("quad", *changes))
    assert done.exit_code == 2
    assert says in done.stderr and "mine.toml" in done.stderr
    assert done.stdout == ""


def test_gains_that_are_unstable_are_told(changed):
    done = gcs(changed("quad", ("[battery]", "[law.mmrac]\nc_angle = 60.0\n[battery]")), "--json")
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert told["unstable"] in ("roll", "pitch") and not told["flies"]


def test_a_wind_that_hover_leaves_no_room_for_is_told(changed):
    done = gcs(changed("quad", ("[battery]", "[law.mmrac]\nguard_wind_m_s = 16.0\n[battery]")))
    assert done.exit_code == 1
    assert "guard_wind_m_s" in done.stdout and "Hover lacks" in done.stdout


@pytest.mark.parametrize("name", ["octo", "no_such.toml"])
def test_an_airframe_that_there_is_none_of(name):
    done = gcs(name)
    assert done.exit_code == 2 and done.stdout == ""


def test_a_figure_that_cannot_be_written(tmp_path):
    assert gcs("quad", "--figure", tmp_path / "none" / "a.png").exit_code == 2
    assert gcs("quad", "--figure", Path("a.txt")).exit_code == 2


def test_the_margins_are_those_of_the_matrices():
    """Just inside a margin the loop settles, just outside it does not."""
    from fcu.guard import stability
    from fcu.process.settings import settings

    file = read(SHIPPED["racer"])
    law, guard = settings(file.rotors, file.tables, 500.0)
    here = stability.hover_of(guard)
    pitch = next(each for each in airframe_check(file).channels if each.name == "pitch")
    for db, settles in ((pitch.gain_down_db - 0.1, True), (pitch.gain_down_db + 0.1, False)):
        off = 10.0 ** (-db / 20.0)
        assert (stability.radius(law, here, "pitch", off) < 1.0) is settles
    ticks = round(pitch.delay_s / law.h)
    assert stability.radius(law, here, "pitch", ticks=ticks) < 1.0
    assert stability.radius(law, here, "pitch", ticks=ticks + 1) >= 1.0
    assert math.isfinite(pitch.settles_s)


@pytest.mark.parametrize(
    ("old", "new", "doubted"),
    [
        ("full_speed_rad_s = ", "full_speed_rad_s = 9", "full_speed_rad_s"),
        ("thrust_max_n = ", "thrust_max_n = 9", "thrust_max_n"),
        ("torque_to_thrust_m = 0.", "torque_to_thrust_m = 0.9", "torque_to_thrust_m"),
        ("[limits]", "[law.my_law]\nk = 1.0\n\n[limits]", "[law.my_law]"),
        ("[limits]", "[law.indy]\nk = 1.0\n\n[limits]", "did you mean indi?"),
    ],
)
def test_what_is_hardly_meant_is_asked(changed, old, new, doubted):
    assert not airframe_check(read(SHIPPED["quad"])).doubts
    found = airframe_check(read(changed("quad", (old, new)))).doubts
    assert len(found) == 1
    assert doubted in found[0]
