"""The campaign on the simulator in C: what is drawn, flown and counted."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.gusts.ends import End
from gcs_tools.gusts.worst_wind import Worst
from tests.foreign_plant import campaign, computed_winds, flights, flights_file
from tests.foreign_plant.fly import anew, compile_plant

BELIEFS = dict.fromkeys(flights.AIRFRAMES, (8.0, 12.0))


def test_a_hundred_seeds_have_every_airframe_in_every_mode_twice() -> None:
    made = [flights.drawn(seed, BELIEFS) for seed in range(37, 137)]
    assert made == [flights.drawn(seed, BELIEFS) for seed in range(37, 137)]
    flown = Counter((each["airframe"], each["mode"]) for each in made)
    assert flown == dict.fromkeys(product(flights.AIRFRAMES, flights.MODES), 2)
    assert max(each["wind_m_s"] for each in made) == 8.0
    assert {each["wind"] for each in made} == set(flights.ANSWERING)


def test_every_second_flight_takes_a_computed_wind_and_the_vehicle_that_it_is_worst_for() -> None:
    vehicle = {"mass_kg": 1.4, "inertia_kg_m2": [0.1] * 3, "drag": [0.05, 0.05, 0.0], "lag_s": 0.04}
    winds = [
        computed_winds.Computed("hexa", "govern", manoeuvre, "torque", 1.0, vehicle, [[0.0] * 4, [1.0] * 4])
        for manoeuvre in ("hover", "turn")
    ]  # fmt: skip
    made = [flights.drawn(seed, BELIEFS, winds) for seed in range(400)]
    plain = [flights.drawn(seed, BELIEFS) for seed in range(400)]
    taken = [each for each in made if each["wind"] == "series"]
    assert Counter((each["airframe"], each["mode"]) for each in taken) == {
        ("hexa", mode): 4 for mode in flights.MODES
    }
    assert {each["of"][0] for each in taken if each["mode"] == "hold"} == {"hover"}
    assert {each["of"][0] for each in taken if each["mode"] == "orbit"} == {"turn"}
    assert all(each["drag"] == vehicle["drag"] for each in taken)
    others = [b for a, b in zip(made, plain, strict=True) if a["wind"] != "series"]
    assert [each for each in made if each["wind"] != "series"] == others


MADE_OF = {"law": "1", "winds": "2"}


def row(seed: int, policy: str = "warn", **changed: object) -> str:
    """A line of a campaign's file."""
    one = {
        "seed": seed, "policy": policy, "airframe": "quad", "mode": "hold", "wind": "series", "saturated": False,
        "saturated_landing": False, "lost": "", "arrived": True, "late": False, "fingerprint": MADE_OF,
    }  # fmt: skip
    return json.dumps(one | changed) + "\n"


def test_a_flight_that_is_there_is_not_flown_again_and_one_cut_short_is(tmp_path: Path) -> None:
    path = tmp_path / "foreign.jsonl"
    with flights_file.opened(path, MADE_OF) as (found, _):
        assert found == []
    path.write_text(row(1) + '{"seed": 2, "pol')
    with flights_file.opened(path, MADE_OF) as (found, out):
        assert [each["seed"] for each in found] == [1]
        out.write(row(2))
    assert path.read_text() == row(1) + row(2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("the text of a user", "line 1 is no flight"),
        ('{"a": 1}', "line 1 is no flight"),
        (row(1) + "damaged\n" + row(2), "line 2 is no flight"),
        (row(1) + '{"seed": 2, "policy": "warn"}\n', "line 2 has no airframe"),
        (row(1) + row(2, "none"), "line 2 is no flight"),
        (row(1, fingerprint={"law": "1", "winds": "9"}), "another winds"),
        (row(1, fingerprint=None), "another law"),
    ],
)
def test_a_file_of_something_else_is_refused_and_left_as_it_is(
    tmp_path: Path, text: str, said: str
) -> None:
    path = tmp_path / "foreign.jsonl"
    path.write_text(text)
    with pytest.raises(flights_file.CampaignError, match=said), flights_file.opened(path, MADE_OF):
        pass
    assert path.read_text() == text


def test_one_campaign_at_a_time_adds_to_a_file(tmp_path: Path) -> None:
    path = tmp_path / "foreign.jsonl"
    with (
        flights_file.opened(path, MADE_OF),
        pytest.raises(flights_file.CampaignError, match="another process"),
        flights_file.opened(path, MADE_OF),
    ):
        pass


def test_flights_that_were_asked_for_count_once() -> None:
    found = [json.loads(row(seed, lost=lost)) for seed, lost in ((1, ""), (1, "away"), (7, ""))]
    assert flights_file.counted(found, [("warn", 1), ("warn", 2)]) == found[:1]


@pytest.mark.parametrize(
    "words", [["-j", "0"], ["--flights", "-3"], ["--flights", "x"], ["--first-seed", "-1"]]
)
def test_numbers_that_are_none_are_wrong_use(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        campaign.main(words)
    assert ended.value.code == 2


def test_files_that_are_none_are_wrong_use_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "winds").write_text('{"airframe": "quad"}\n')
    (tmp_path / "empty").touch()
    for words in (
        ["--out", "pipe"], ["--out", "no/where"], ["--out", "."], ["--computed", "winds"],
        ["--computed", "empty"], ["--computed", "pipe"], ["--computed", "absent"],
    ):  # fmt: skip
        assert campaign.main([words[0], str(tmp_path / words[1])]) == 2, words
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith(f"Error: {tmp_path / words[1]}"), line


def test_a_process_that_died_is_told_and_what_was_flown_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def flying(*_: object) -> Iterator[flights.Found]:
        yield json.loads(row(1))
        raise BrokenProcessPool

    monkeypatch.setattr(campaign, "fly_all", flying)
    monkeypatch.setattr(campaign, "compile_plant", lambda folder: folder)
    monkeypatch.setattr(campaign, "believed", lambda airframe: (8.0, 12.0))
    out = tmp_path / "foreign.jsonl"
    assert campaign.main(["--out", str(out), "--flights", "2"]) == 3
    assert len(capsys.readouterr().err.splitlines()) == 1
    made_of = flights_file.fingerprint(None)
    with flights_file.opened(out, made_of) as (found, _):
        assert [each["seed"] for each in found] == [1] and found[0]["fingerprint"] == made_of


def test_the_time_of_a_step_is_announced_where_somebody_governs() -> None:
    made, here = {"airframe": "s1000"}, (0.0, 0.0, -8.0)
    said = flights.announced_s(made, "govern", here, (3.0, 4.0, -8.0))
    farther = flights.announced_s(made, "govern", here, (6.0, 8.0, -8.0))
    assert said is not None and farther is not None and 1.0 < said < farther
    assert flights.announced_s(made, "warn", here, (3.0, 4.0, -8.0)) is None


def test_a_computed_wind_is_told_in_the_axes_of_the_link() -> None:
    rows = [[1.0, 9.0, 9.0, 9.0], [3.0, 1.0, 2.0, 3.0], [7.0, 4.0, 5.0, 6.0], [8.0, 9.0, 9.0, 9.0]]
    end = End(mass_kg=1.0, inertia_kg_m2=(1.0,), drag=(0.1,), rotor_lag_s=0.05)
    worst = Worst(
        limit="torque", part=1, from_s=0.0, to_s=9.0, at_s=6.8, still_n=1.0, drawn_n=1.0, begun_n=1.0, begun="still",
        computed_n=1.0, end=end, rounds=1, saturated=False, samples=np.array(rows),
    )  # fmt: skip
    assert computed_winds.of_worst(worst) == [[3.0, 2.0, 1.0, -3.0], [7.0, 5.0, 4.0, -6.0]]


def test_what_is_believed_is_asked_of_the_command_line() -> None:
    assert flights.believed("s1000") == (12.0, 20.0)


@pytest.mark.slow
def test_a_flight_by_a_copy_is_to_the_bit_one_by_a_process_of_its_own(tmp_path: Path) -> None:
    program = compile_plant(tmp_path)
    made = flights.drawn(35, BELIEFS) | {"drag": 0.15, "mass_kg": 8.0}
    assert (made["airframe"], made["mode"]) == ("s1000", "hold")
    made |= {"wind": "against-thrust", "wind_m_s": 12.0, "wind_rate_m_s2": 20.0}
    made |= {"vertical": False, "slope_deg": 0.0}
    [found] = campaign.fly_all([("govern", made)], program, 1)
    assert campaign.kept(found), found
    assert 0.0 < found["touchdown_m_s"] < 2.0
    again = flights.fly(program, "govern", made, anew)
    told = "told", "texts"  # by the wall clock
    assert {k: v for k, v in again.items() if k not in told} == {
        k: v for k, v in found.items() if k not in told
    }
    beyond = flights.fly(program, "warn", made | {"wind_m_s": 40.0, "wind_rate_m_s2": 400.0})
    assert not campaign.kept(beyond)


def test_the_table_counts() -> None:
    one = {
        "policy": "govern", "airframe": "quad", "mode": "hold", "wind": "series", "saturated": False,
        "saturated_landing": False, "lost": "", "arrived": True, "late": False, "announced_s": 3.0,
    }  # fmt: skip
    two = one | {"saturated": True, "wind": "with-thrust", "announced_s": None}
    rows = {cells[1].strip(): cells[2:] for cells in (line.split("|") for line in campaign.table([one, two]).splitlines())}  # fmt: skip
    assert rows["**govern**"][0].strip() == "1 of 2 (1.26 to 98.74)"
    assert [cell.split(" (")[0].strip() for cell in rows["quad"][:5]] == [
        "1 of 2", "0 of 2", "0 of 2", "0 of 2", "0 of 1",
    ]  # fmt: skip
    assert rows["computed winds"][0].startswith(" 0 of 1")
    assert rows["winds that answer"][0].startswith(" 1 of 1")
