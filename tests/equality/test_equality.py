"""A planted difference is found, and named. What no two runs share is not."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from tests.equality.cases import Case, cases
from tests.equality.comparison import compared, difference, traffic_difference
from tests.equality.ground_requests import requests
from tests.equality.masks import masked
from tests.equality.recording import record_case

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture
def two(tmp_path):
    """Two recordings of a refusal and of a result, equal."""
    for name in ("a", "b"):
        for output, text in {
            "refusals/x/exit": "exit code 2\n",
            "missions/y/trajectory": "f00\n",
        }.items():
            path = tmp_path / name / output
            path.parent.mkdir(parents=True)
            path.write_text(text)
    return tmp_path / "a", tmp_path / "b"


def test_equal_recordings_are_equal(two):
    assert compared(*two)


@pytest.mark.parametrize(
    "planted", ["refusals/x/exit", "missions/y/trajectory", "refusals/x/stderr"]
)
def test_a_planted_difference_is_found(two, planted, capsys):
    (two[1] / planted).write_text("exit code 0\n")
    assert not compared(*two)
    assert planted in capsys.readouterr().out
    assert compared(*two, only=["campaigns/*"])


def test_the_first_difference_is_shown():
    assert difference("a\nb\n", "a\nc\n") == ["-b", "+c"]
    many = "\n".join(map(str, range(5000)))
    assert difference(many, many.replace("\n4321\n", "\nx\n")) == ["line 4322", "-4321", "+x"]


def _traffic(*altitudes, before=()):
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    messages = [
        *before,
        *(mavlink.MAVLink_altitude_message(0, 0, m, 0, 0, 0, 0) for m in altitudes),
    ]
    lines = []
    for number, message in enumerate(messages):
        lines.append(f"{0.02 * number:.2f} {message.pack(vehicle).hex()}")
        vehicle.seq += 1
    return "\n".join(lines)


def test_of_traffic_the_field_that_differs_is_named():
    (found,) = traffic_difference(_traffic(1.0, 2.0, 3.0), _traffic(1.0, 2.5, 3.0))
    assert found.startswith("ALTITUDE: 1 of 3/3")
    assert "altitude_amsl 2.0 -> 2.5" in found
    assert not traffic_difference(_traffic(1.0, 2.0), _traffic(1.0, 2.0))


def test_a_message_that_moves_nothing_but_sequence_numbers_is_alone_in_the_list():
    text = mavlink.MAVLink_statustext_message(6, b"hello")
    left, right = _traffic(1.0, 2.0), _traffic(1.0, 2.0, before=(text,))
    kinds = {line.split(":")[0] for line in traffic_difference(left, right)}
    assert "STATUSTEXT" in kinds


def test_wall_times_and_folders_are_masked_and_numbers_flown_are_not(tmp_path):
    text = f"wall_time_s = 0.62\nsim_time_s = 19.998\n12 times real time; run in {tmp_path}/run\n"
    assert masked(text, {tmp_path: "<folder>"}) == (
        "wall_time_s = <wall>\nsim_time_s = 19.998\n<wall> times real time; run in <folder>/run\n"
    )


def test_every_mission_is_flown_both_ways_and_no_case_twice():
    names = [case.name for case in cases(ROOT)]
    assert len(set(names)) == len(names)
    shipped = [
        path for path in (ROOT / "missions").rglob("*.toml") if path.parent.name != "campaigns"
    ]
    assert sum(name.startswith("missions/") for name in names) == 2 * len(shipped)
    assert sum(name.startswith("ground/") for name in names) == 10


def test_a_seed_draws_the_same_requests_again():
    assert requests(3, 20.0) == requests(3, 20.0)
    assert requests(3, 20.0) != requests(4, 20.0)


@pytest.mark.slow
def test_a_recorded_refusal_holds_texts_and_exit_code(tmp_path):
    case = Case("x", (("gcs_tools", "fly", "bad.toml"),), {"bad.toml": "title = \n"})
    record_case(case, Path(sys.executable), ROOT, tmp_path / "x")
    assert (tmp_path / "x/exit").read_text().endswith("exit code 2\n")
    assert "bad.toml" in (tmp_path / "x/stderr").read_text()
    assert (tmp_path / "x/files").read_text() == "bad.toml\n"
