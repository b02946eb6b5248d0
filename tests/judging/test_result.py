"""A result is finite, whole or absent, and read back as it was."""

import hashlib
import json
import math
import os
import struct
import xml.etree.ElementTree as ET
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fcu.interface.event_log import Event, event
from fcu.interface.status_texts import Code, Told, words
from fcu.kernel.buffers import columns, size
from gcs_tools.judging.expectations import Expectation
from gcs_tools.judging.result import Result, ResultError, junit, read, trajectory_sha256
from gcs_tools.judging.vehicle_warnings import Warned, warnings
from gcs_tools.missions.mission import Value
from sitl_plant.physics.types import PlantRecord

MET = Expectation("ended", "time or arrived", "time", True, "ended = time or arrived")
MISSED = Expectation("reference_error_rms_m", 0.03, 0.5, False, "reference_error_rms_m ≤ 0.03")
RESULT = Result(
    mission="paper_nominal",
    title="The octocopter flies the paper's wind.",
    passed=True,
    exit_code=0,
    ended="time",
    seed=1,
    rate_hz=500.0,
    sim_time_s=60.0,
    wall_time_s=1.2,
    real_time_factor=50.0,
    startup_s=0.8,
    ticks=30_000,
    slips=0,
    trajectory_sha256="0" * 64,
    versions={"m-mrac": "0.1.0"},
    values={
        "law.f_m": Value(1.0, "mission"),
        "plant.mass_kg": Value(8.0, "sitl_plant/airframes/s1000.toml"),
    },
    expectations=[MET],
    metrics={"reference_error_rms_m": 0.02, "reference_error_final_m": None},
    warnings=[Warned(12.3, "Setpoint 990 m away limited to 100 m", 2)],
)
FAILED = replace(
    RESULT, mission="paper_fast", passed=False, exit_code=1, expectations=[MET, MISSED]
)
BROKEN = replace(
    RESULT, mission="weak_rotor", passed=False, exit_code=3, ended="aborted",
    expectations=[], error="sitl-plant died at 3.214 s",
)  # fmt: skip


def test_a_result_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    for result in (RESULT, FAILED, BROKEN):
        result.write(path)
        assert read(path) == result
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_keys_of_a_result_are_those_promised(tmp_path: Path) -> None:
    RESULT.write(tmp_path / "result.json")
    content = json.loads((tmp_path / "result.json").read_text())
    assert content["schema_version"] == 2
    assert content["expectations"][0]["name"] == "ended"
    assert content["values"]["law.f_m"] == {"value": 1.0, "origin": "mission"}
    assert set(content) >= {
        "mission", "title", "passed", "exit_code", "ended", "seed", "rate_hz", "sim_time_s",
        "wall_time_s", "real_time_factor", "startup_s", "ticks", "slips", "trajectory_sha256",
        "versions", "values", "expectations", "metrics", "settle_s", "warnings",
    }  # fmt: skip
    (warned,) = content["warnings"]
    assert warned == {
        "time_s": 12.3, "text": "Setpoint 990 m away limited to 100 m", "count": 2, "first_s": None,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("result", "name"),
    [
        (replace(RESULT, real_time_factor=math.inf), "real_time_factor is inf"),
        (replace(RESULT, metrics={"thrust_max_n": math.nan}), "metrics.thrust_max_n is nan"),
        (replace(RESULT, values={"a.b": Value([0.0, math.inf], "")}), r"a.b.value\[1\] is inf"),
    ],
)
def test_what_is_not_finite_is_named_and_not_written(
    tmp_path: Path, result: Result, name: str
) -> None:
    path = tmp_path / "result.json"
    RESULT.write(path)
    with pytest.raises(ResultError, match=name):
        result.write(path)
    assert read(path) == RESULT


def test_a_write_that_fails_leaves_the_old_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result.json"
    RESULT.write(path)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResultError, match=r"result.json: No space left on device"):
        FAILED.write(path)
    assert read(path) == RESULT
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_refusals_name_the_file_and_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    for text, reason in (
        (None, "No such file"),
        ("{", "not JSON"),
        ("[]", "not a result"),
        ('{"schema_version": 3}', "of version 3; this program reads version 2"),
        ('{"schema_version": 1}', "of version 1, .*fly the mission again"),
        ('{"schema_version": 2}', "not a result"),
        (
            '{"schema_version": 2, "values": {}, "expectations": [], "warnings": []}',
            "not a result .*'mission'",
        ),
    ):
        if text is not None:
            path.write_text(text)
        with pytest.raises(ResultError, match=f"result.json: .*{reason}"):
            read(path)


VALUES = ('"x"', "[]", "{}", "null", "true", "NaN", "1e999", "9" * 400)


@pytest.mark.parametrize(
    "key", ["ticks", "rate_hz", "ended", "metrics", "limit", "time_s", "changes"]
)
def test_a_value_of_another_type_is_no_result(tmp_path: Path, key: str) -> None:
    """Or it would be met where it is printed, or subtracted."""
    whole = asdict(RESULT)
    path = tmp_path / "result.json"
    allowed = {
        "ticks": {"9" * 400}, "ended": {'"x"'}, "metrics": {"{}"}, "limit": {'"x"'}, "changes": {"[]"},
    }.get(key, set())  # fmt: skip
    text = json.dumps(_with(whole, key, "here"))
    for value in VALUES:
        path.write_text(text.replace('"here"', value))
        if value in allowed:
            read(path)
            continue
        with pytest.raises(ResultError, match=r"result\.json: not"):
            read(path)


def _with(content: Any, key: str, value: str) -> Any:
    """The same with another value of a key, wherever it is."""
    if isinstance(content, list):
        return [_with(each, key, value) for each in content]
    if not isinstance(content, dict):
        return content
    return {k: value if k == key else _with(v, key, value) for k, v in content.items()}


@pytest.mark.parametrize("what", ["deep", "large", "pipe"])
def test_what_would_exhaust_its_reader_is_no_result(tmp_path: Path, what: str) -> None:
    path = tmp_path / "result.json"
    if what == "pipe":
        os.mkfifo(path)
    else:
        path.write_text("[" * 100_000 if what == "deep" else " " * 2_000_000 + "{}")
    with pytest.raises(ResultError, match=r"result\.json"):
        read(path)


def told(t: float, what: Told | str, level: str = "warning", who: str = "fcu") -> Event:
    return event(t, level, who, what)


def test_what_the_vehicle_warned_of_is_kept_once_and_counted() -> None:
    """In the order in which it came; neither what it merely says, nor the plant, nor after the end."""
    said = [
        told(8.0, Told(Code.NOT_AS_BELIEVED, (Told(Code.THRUST_OFF),))),
        told(2.0, "free text of 2 words"),
        told(3.0, "free text of 2 words"),
        told(3.2, "free text of 3 words"),
        told(3.5, Told(Code.SETPOINT_FAR, (12.5, 10.0))),
        told(3.6, Told(Code.SETPOINT_FAR, (12.4, 10.0))),
        told(4.0, Told(Code.ARMED), "info"),
        told(5.0, Told(Code.LAW_NOT_FINITE, ("T_c",)), "error"),
        told(6.0, Told(Code.FLIGHT_ENDED, ("hit the ground",)), who="plant"),
        told(7.0, Told(Code.NOT_AS_BELIEVED, (Told(Code.HEAVIER, (9.0,)),))),
        told(10.1, Told(Code.SETPOINT_FAR, (12.3, 10.0))),
    ]
    found = warnings(said, until_s=10.0)
    assert found[2].text == words(Told(Code.SETPOINT_FAR, (12.5, 10.0)))
    assert [(each.time_s, each.count) for each in found] == [
        (2.0, 2), (3.2, 1), (3.5, 2), (5.0, 1), (7.0, 1), (8.0, 1),
    ]  # fmt: skip


def test_of_warnings_of_a_force_that_is_missing_the_greatest_is_kept() -> None:
    def short(t: float, speed: float, lack: float) -> Event:
        return told(t, Told(Code.SETPOINT_SHORT, (Told(Code.SPEED, (speed,)), lack)))

    lacks = [short(13.0, 1.4, 0.7), short(21.0, 3.0, 31.2), short(22.0, 2.0, 20.6)]
    refused = Told(Code.LACKS, (Told(Code.WAY, (1.0,)), 3.0, "2 m"))
    more = Told(Code.LACKS, (Told(Code.WAY, (1.0,)), 5.0, "2 m"))
    rejected = [
        told(14.0 + i, Told(Code.SETPOINT_REFUSED, (r,))) for i, r in enumerate((refused, more))
    ]
    found = warnings([*lacks, *rejected, told(16.0, "free text")], until_s=30.0)
    assert [(each.time_s, each.count, each.first_s) for each in found] == [
        (15.0, 2, 14.0), (16.0, 1, None), (21.0, 3, 13.0),
    ]  # fmt: skip
    assert "32 N" in found[2].text
    assert str(found[2]).endswith("(the greatest of 3, the first at 13.0 s)")


def test_the_hash_is_of_the_first_22_columns() -> None:
    names = columns(PlantRecord)
    assert names[0] == "t" and names[21] == "state.Omega.r8"
    rows = np.arange(2.0 * size(PlantRecord)).reshape(2, -1)
    width = size(PlantRecord)
    numbers = [*range(22), *range(width, width + 22)]
    assert trajectory_sha256(rows) == hashlib.sha256(struct.pack("<44d", *numbers)).hexdigest()


def test_junit_has_two_names_for_two_missions_of_one_name(tmp_path: Path) -> None:
    for number, pair in enumerate(
        [(RESULT, RESULT), (RESULT, replace(FAILED, mission=RESULT.mission))]
    ):
        junit(pair, tmp_path / f"{number}.xml")
        names = [case.get("name") for case in ET.parse(tmp_path / f"{number}.xml").getroot()]
        assert names == ["paper_nominal", "paper_nominal-1"]


def test_junit_tells_failures_from_errors(tmp_path: Path) -> None:
    path = tmp_path / "junit.xml"
    junit([RESULT, FAILED, BROKEN], path)
    suite = ET.parse(path).getroot()
    assert suite.attrib == {
        "name": "gcs fly", "tests": "3", "failures": "1", "errors": "1", "time": "6.000",
    }  # fmt: skip
    good, failed, broken = suite
    assert (good.get("name"), len(good)) == ("paper_nominal", 0)
    failure = failed.find("failure")
    assert failure is not None and failure.text is not None
    assert failure.get("message") == "reference_error_rms_m ≤ 0.03: 0.5"
    assert "[expect] reference_error_rms_m ≤ 0.03: 0.5" in failure.text
    error = broken.find("error")
    assert error is not None
    assert error.get("message") == "sitl-plant died at 3.214 s"
