"""Wind from a file: samples of the velocity of the air over time, beside a mission."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.samples_file import SamplesError, read_wind, write_wind
from fcu.kernel.rows import column
from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import envelope
from gcs_tools.missions.mission import MissionError, load
from sitl_plant.burst import air_by_tick
from sitl_plant.physics.types import PlantRecord

MISSION = """title = "The vehicle hovers in a wind of its own."
[flight]
duration_s = 2.0
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }]
[wind]
steady_m_s = [1.0, 0.0, 0.0]
file = "gust.csv"
"""
GUST = "t_s,x_m_s,y_m_s,z_m_s\n0.5,0,0,0\n1.0,2,-4,1\n"


def written(folder: Path, gust: str) -> Path:
    (folder / "gust.csv").write_text(gust)
    (folder / "x.toml").write_text(MISSION)
    return folder / "x.toml"


def test_a_byte_order_mark_is_passed_over_and_a_column_is_there_once(tmp_path):
    written(tmp_path, "\ufeff" + GUST)
    assert read_wind(tmp_path / "gust.csv").shape == (2, 4)
    written(tmp_path, GUST.replace("z_m_s", "z_m_s,x_m_s"))
    with pytest.raises(SamplesError, match=r"gust\.csv:1: expected one column x_m_s, got 2"):
        read_wind(tmp_path / "gust.csv")


def air(rows):
    return column(PlantRecord, rows, "v_air_E")


def test_the_air_is_that_of_the_file_added_to_the_rest(tmp_path: Path) -> None:
    """Straight between two samples, before the first as the first, after the last as the last."""
    scene = scenario(load(written(tmp_path, GUST)))
    plant, _ = law_alone.fly(scene)
    at = {0.0: (1, 0, 0), 0.5: (1, 0, 0), 0.75: (2, -2, 0.5), 1.0: (3, -4, 1), 1.9: (3, -4, 1)}
    for t, expected in at.items():
        assert air(plant)[round(t * 500)] == pytest.approx(expected), t


def test_samples_that_are_written_are_read_again_to_the_bit(tmp_path: Path) -> None:
    rows = np.random.default_rng(1).normal(size=(50, 4))
    rows[:, 0] = np.cumsum(np.abs(rows[:, 0]))
    write_wind(tmp_path / "gust.csv", rows)
    assert read_wind(tmp_path / "gust.csv").tobytes() == rows.tobytes()


def test_flights_with_samples_of_wind_fly_beside_others_to_the_same_bits(tmp_path: Path) -> None:
    """Beside flights without samples too."""
    scene = scenario(load(written(tmp_path, GUST)))
    calm = replace(scene, wind=None)
    found = law_flights.fly([calm, scene, calm, scene])
    alone = law_alone.fly(scene)[0]
    assert [f.plant.tobytes() == alone.tobytes() for f in found] == [False, True, False, True]


def test_without_samples_the_plant_is_told_of_none() -> None:
    assert air_by_tick(load("gust_step").wind.steady_m_s, None, 500.0).shape == (0, 3)


@pytest.mark.parametrize(
    ("gust", "said"),
    [
        ("", "gust.csv:1: expected a line that names the columns t_s, x_m_s, y_m_s, z_m_s"),
        (GUST.replace("z_m_s", "up"), "z_m_s is missing"),
        (GUST.replace("2,-4", "2,fast"), "gust.csv:3: expected four finite numbers"),
        (GUST.replace("2,-4", "2,-4e9"), "gust.csv:3: expected four finite numbers"),
        (GUST.replace("\n1.0", "\n0.5"), "expected a time after 0.5 s, got 0.5"),
        (GUST.replace("\n0.5", "\n-1"), "expected times from 0 to 3600 s of the flight, got -1"),
        ("t_s,x_m_s,y_m_s,z_m_s\n", "expected a sample or more"),
    ],
)
def test_a_file_that_holds_no_wind_is_an_error(tmp_path: Path, gust: str, said: str) -> None:
    with pytest.raises(MissionError) as raised:
        load(written(tmp_path, gust))
    assert said in str(raised.value)
    assert "x.toml:7: [wind] file" in str(raised.value)


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path, GUST)
    (tmp_path / "gust.csv").unlink()
    with pytest.raises(MissionError, match=r"\[wind\] file: .*No such file"):
        load(path)


def test_a_wind_beyond_what_is_believed_is_told_before_the_flight(tmp_path: Path) -> None:
    """A gust of 21 m/s in half a second is neither as slow nor as gradual as the guard believes."""
    within = envelope(load(written(tmp_path, GUST)))
    assert not any("its wind" in remark for remark in within.remarks)
    gust = GUST.replace("2,-4,1", "21,0,0")
    remarks = envelope(load(written(tmp_path, gust))).remarks
    assert any("up to 22 m/s, is beyond guard_wind_m_s 12" in remark for remark in remarks)
    assert any("up to 42 m/s^2, is beyond guard_wind_rate_m_s2 20" in remark for remark in remarks)


def test_a_parquet_file_is_the_same_wind_as_its_csv(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    from gcs_tools.missions import parquet_samples

    rows = np.array([[0.0, 1.0, 2.0, 3.0], [2.5, -1.0, 0.5, 0.0]])
    columns = dict(zip(("t_s", "x_m_s", "y_m_s", "z_m_s"), rows.T, strict=True))
    parquet.write_table(pyarrow.table({"other": ["a", "b"], **columns}), tmp_path / "w.parquet")
    np.testing.assert_array_equal(parquet_samples.read_wind(tmp_path / "w.parquet"), rows)
    parquet.write_table(pyarrow.table({**columns, "t_s": [1.0, 1.0]}), tmp_path / "w.parquet")
    with pytest.raises(SamplesError, match="expected a time after 1 s"):
        parquet_samples.read_wind(tmp_path / "w.parquet")
    parquet.write_table(pyarrow.table({**columns, "x_m_s": [None, 1.0]}), tmp_path / "w.parquet")
    with pytest.raises(SamplesError, match="finite numbers"):
        parquet_samples.read_wind(tmp_path / "w.parquet")
    parquet.write_table(pyarrow.table({"t_s": [0.0]}), tmp_path / "w.parquet")
    with pytest.raises(SamplesError, match="x_m_s, y_m_s, z_m_s missing"):
        parquet_samples.read_wind(tmp_path / "w.parquet")
    (tmp_path / "w.parquet").write_text("nothing")
    with pytest.raises(SamplesError, match="expected a Parquet file"):
        parquet_samples.read_wind(tmp_path / "w.parquet")
    parquet.write_table(
        pyarrow.Table.from_arrays([*map(pyarrow.array, rows.T), pyarrow.array(rows[:, 0])], [*columns, "t_s"]),
        tmp_path / "w.parquet",
    )  # fmt: skip
    with pytest.raises(SamplesError, match="expected one column t_s, got 2"):
        parquet_samples.read_wind(tmp_path / "w.parquet")
    parquet.write_table(
        pyarrow.table({**columns, "x_m_s": ["\x1b[2J", "1"]}), tmp_path / "w.parquet"
    )
    with pytest.raises(SamplesError) as error:
        parquet_samples.read_wind(tmp_path / "w.parquet")
    assert str(error.value).isprintable()
    for kind in (os.mkfifo, os.mkdir):
        (tmp_path / "w.parquet").unlink()
        kind(tmp_path / "w.parquet")
        with pytest.raises(SamplesError, match=r"w\.parquet: "):
            parquet_samples.read_wind(tmp_path / "w.parquet")
