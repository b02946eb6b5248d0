"""Headings of figures name files, and do not say where they are."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from fcu.interface.airframe import read
from gcs_tools.flight.run import heading
from gcs_tools.judging.airframe_check import airframe_check
from gcs_tools.missions.mission import load, override, with_airframe, with_law
from gcs_tools.pictures.plot.airframe import save
from tests.own_airframe.test_flying import QUAD

CASCADE = Path(__file__).parents[1] / "own_law" / "plain_cascade.py"


def test_a_flight_names_its_law_and_its_airframe_without_their_folders(tmp_path):
    shutil.copy(QUAD, tmp_path / "lab3.toml")
    shutil.copy(CASCADE, tmp_path / "my_pid.py")
    mission = with_law(load("gust_step"), str(tmp_path / "my_pid.py"))
    mission = with_airframe(mission, str(tmp_path / "lab3.toml"))
    title = heading(override(mission, "law.k_r=1.2"))
    for said in ("my_pid.py", "lab3.toml", "law.k_r = 1.2"):
        assert said in title
    assert str(tmp_path) not in title


@pytest.mark.computes
def test_the_figure_of_an_airframe_is_headed_by_its_name(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(Figure, "suptitle", lambda _self, text, **_more: said.append(text))
    shutil.copy(QUAD, tmp_path / "lab3.toml")
    save(airframe_check(read(tmp_path / "lab3.toml")), tmp_path / "lab3.png")
    assert [text.partition(":")[0] for text in said] == ["lab3"]
