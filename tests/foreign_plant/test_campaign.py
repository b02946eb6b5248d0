"""The campaign on the simulator in C: what is drawn, flown and counted."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.foreign_plant import campaign
from tests.foreign_plant.fly import compile_plant

BELIEFS = dict.fromkeys(campaign.AIRFRAMES, (8.0, 12.0))


def test_a_number_of_a_seed_is_one_flight() -> None:
    made = [campaign.drawn(3, number, BELIEFS) for number in range(200)]
    assert made == [campaign.drawn(3, number, BELIEFS) for number in range(200)]
    assert made[:5] != [campaign.drawn(4, number, BELIEFS) for number in range(5)]
    assert {each["mode"] for each in made} == set(campaign.MODES)
    assert {each["airframe"] for each in made} == set(campaign.AIRFRAMES)
    assert max(each["wind_m_s"] for each in made) == 8.0


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
