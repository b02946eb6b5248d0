"""The campaign on the simulator in C: what is drawn, flown and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_tools.gusts.ends import End
from gcs_tools.gusts.worst_wind import Worst
from tests.foreign_plant import campaign, computed_winds
from tests.foreign_plant.fly import compile_plant

BELIEFS = dict.fromkeys(campaign.AIRFRAMES, (8.0, 12.0))


def test_a_number_of_a_seed_is_one_flight() -> None:
    made = [campaign.drawn(3, number, BELIEFS) for number in range(200)]
    assert made == [campaign.drawn(3, number, BELIEFS) for number in range(200)]
    assert made[:5] != [campaign.drawn(4, number, BELIEFS) for number in range(5)]
    assert {each["mode"] for each in made} == set(campaign.MODES)
    assert {each["airframe"] for each in made} == set(campaign.AIRFRAMES)
    assert max(each["wind_m_s"] for each in made) == 8.0


def test_every_second_flight_takes_a_computed_wind_and_the_vehicle_that_it_is_worst_for() -> None:
    vehicle = {"mass_kg": 1.4, "inertia_kg_m2": [0.1] * 3, "drag": [0.05, 0.05, 0.0], "lag_s": 0.04}
    winds = [
        computed_winds.Computed("hexa", "govern", manoeuvre, "torque", 1.0, vehicle, [[0.0] * 4, [1.0] * 4])
        for manoeuvre in ("hover", "turn")
    ]  # fmt: skip
    made = [campaign.drawn(3, number, BELIEFS, winds) for number in range(400)]
    plain = [campaign.drawn(3, number, BELIEFS) for number in range(400)]
    taken = [each for each in made if each["wind"] == "series"]
    assert {(each["airframe"], each["mode"]) for each in taken} == {
        ("hexa", "hold"),
        ("hexa", "orbit"),
    }
    assert {tuple(each["of"]) for each in taken} == {("hover", "torque"), ("turn", "torque")}
    assert all(each["number"] % 2 and each["drag"] == vehicle["drag"] for each in taken)
    assert [a for a, b in zip(made, plain, strict=True) if a["wind"] != "series"] == [
        b for a, b in zip(made, plain, strict=True) if a["wind"] != "series"
    ]


def test_a_computed_wind_is_told_in_the_axes_of_the_link() -> None:
    rows = [[1.0, 9.0, 9.0, 9.0], [3.0, 1.0, 2.0, 3.0], [7.0, 4.0, 5.0, 6.0], [8.0, 9.0, 9.0, 9.0]]
    end = End(mass_kg=1.0, inertia_kg_m2=(1.0,), drag=(0.1,), rotor_lag_s=0.05)
    worst = Worst(
        limit="torque", part=1, from_s=0.0, to_s=9.0, at_s=6.8, still_n=1.0, drawn_n=1.0, begun_n=1.0, begun="still",
        computed_n=1.0, end=end, rounds=1, saturated=False, samples=np.array(rows),
    )  # fmt: skip
    assert computed_winds.of_worst(worst) == [[3.0, 2.0, 1.0, -3.0], [7.0, 5.0, 4.0, -6.0]]


def test_what_is_believed_is_asked_of_the_command_line() -> None:
    assert campaign.believed("s1000") == (12.0, 20.0)


@pytest.mark.slow
def test_a_flight_tells_what_came_of_it(tmp_path: Path) -> None:
    program = compile_plant(tmp_path)
    made = campaign.drawn(1, 2, BELIEFS) | {"airframe": "s1000", "mode": "hold", "drag": 0.15}
    made |= {"wind": "against-thrust", "wind_m_s": 12.0, "wind_rate_m_s2": 20.0, "mass_kg": 8.0}
    found = campaign.fly(program, "govern", made)
    assert not found["saturated"]
    assert (found["arrived"], found["disarmed"], found["lost"]) == (True, True, "")
    assert 0.0 < found["touchdown_m_s"] < 2.0
    beyond = campaign.fly(program, "warn", made | {"wind_m_s": 40.0, "wind_rate_m_s2": 400.0})
    assert beyond["saturated"] or beyond["lost"] or not beyond["arrived"]


def test_the_table_counts() -> None:
    one = {"airframe": "quad", "mode": "hold", "saturated": False, "lost": "", "arrived": True}
    two = one | {"saturated": True, "saturated_landing": False}
    said = campaign.table([one, two]).splitlines()
    assert said[0].split()[:4] == ["saturated", "1", "of", "2,"]
    assert said[1].split()[:2] == ["lost", "0"]
    assert said[3].split()[:3] == ["in", "landing", "1"]
    assert said[4].split() == ["quad", "hold", "1", "of", "2"]
