"""A body that flies and is not believed in is told, with what is believed."""

from __future__ import annotations

import pytest

from gcs_tools.judging.belief_check import unbelieved
from gcs_tools.missions.mission import load, with_airframe
from tests import command_line

LIGHT, DROPPED = "plant.mass_kg=1.5", "plant.mass_change={ at_s = 1.0, mass_kg = 2.0 }"
ROUND = "plant.inertia_kg_m2=[0.3, 0.3, 0.9]"


@pytest.mark.parametrize(("settings", "told"), [
    ([], []),
    (["plant.mass_kg=9.0"], []),
    ([LIGHT], ["plant.mass_kg is 1.5 kg (--set)", "s1000 assumes 7 to 9"]),
    ([DROPPED], ["plant.mass_change.mass_kg is 2 kg"]),
    (["plant.mass_change={ at_s = 1.0, mass_ratio = 0.2 }"], []),
    ([ROUND], ["about z is 0.9 kg m^2", "0.404 to 0.5192"]),
    ([LIGHT, "law.guard_mass_kg=[1.0, 2.0]"], []),
    (["law.guard_mass_kg=[1.0, 2.0]"], ["plant.mass_kg is 8 kg", "law.guard_mass_kg says 1 to 2"]),
])  # fmt: skip
def test_what_flies_is_held_against_what_is_believed(settings, told):
    sentence = unbelieved(load("gust_step", settings))
    assert bool(sentence) == bool(told)
    assert all(part in sentence for part in told)


def test_the_masses_of_a_mission_are_those_of_its_own_vehicle():
    quad = with_airframe(load("gust_step", ["plant.mass_kg=8.0"]), "quad")
    assert "quad assumes" in unbelieved(quad)
    assert unbelieved(with_airframe(load("benchmark/drop"), "quad")) == ""


def test_fly_says_so_on_one_line_of_standard_error_and_envelope_among_its_remarks(tmp_path):
    flown = command_line.gcs(
        "fly", "gust_step", "--set", ROUND, "--set", "flight.duration_s=0.2", "--in-process",
        "--figure", "never", "--record", "none", "--out", tmp_path / "run",
    )  # fmt: skip
    lines = [
        line for line in flown.stderr.splitlines() if "outside what the controller assumes" in line
    ]
    assert len(lines) == 1
    assert lines[0].startswith("gust_step: ")
    assert "outside what the controller assumes" not in flown.stdout
    assert "about z is 0.9 kg m^2" in " ".join(
        command_line.gcs("envelope", "gust_step", "--set", ROUND).stdout.split()
    )


@pytest.mark.parametrize(("part", "told"), [(5e-10, False), (5e-9, True)])
def test_an_end_of_what_is_believed_is_believed_but_for_rounding(part, told):
    assert bool(unbelieved(load("gust_step", [f"plant.mass_kg={9.0 * (1.0 + part)!r}"]))) is told
