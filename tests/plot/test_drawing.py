"""Every figure is drawn of any flight, and what is drawn keeps peaks, gaps and limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from gcs_tools.pictures.plot.figures import FORMATS, STANDARD, save
from gcs_tools.pictures.plot.style import broken, flagged, zoom
from gcs_tools.pictures.plot.window import Window

STARTS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_figure_is_written_in_each_format(made: Any, tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"tracking.{kind}"
    save("tracking", Window.of(made.recording(), None, None), path, kind, "made up")
    assert path.read_bytes().startswith(STARTS[kind])


@pytest.mark.computes
def test_question_answer_and_remarks_stand_in_the_figure(made: Any, tmp_path: Path) -> None:
    path = tmp_path / "wind.svg"
    made.set_fcu(**{"wind.v_air_E.x": 3.0, "wind.v_air_E.y": 4.0})
    window = Window.of(made.recording(), None, None)
    save("wind", window, path, "svg", "made_up, flight.mcap", ("Messages lost: 3 of /fcu/wind.",))
    text = path.read_text(encoding="utf-8")
    for said in (
        "Is the wind known?", "Horizontal RMS 5 m/s", "made_up, flight.mcap", "Messages lost: 3",
        "true here: 0.15, 0.15, 0.15 N/(m/s)²", "The vertical wind is not estimated",
    ):  # fmt: skip
        assert said in text


@pytest.mark.slow
@pytest.mark.parametrize("name", STANDARD)
@pytest.mark.parametrize(("n", "bad"), [(1, False), (3000, True)])
def test_any_flight_is_drawn(
    make: Callable[..., Any], tmp_path: Path, name: str, n: int, bad: bool
) -> None:
    made = make(n / 500.0)
    random = np.random.default_rng(1)
    made.plant[:, 1:] = random.random(made.plant[:, 1:].shape)
    made.fcu[:, 1:] = random.random(made.fcu[:, 1:].shape)
    if bad:
        made.plant[n // 2 :, 1:], made.fcu[n // 2 :, 1:] = np.nan, np.inf
    made.set_fcu(engaged=2.0)
    path = tmp_path / "figure.png"
    save(name, Window.of(made.recording(), None, None), path, "png", "noise")
    assert path.read_bytes().startswith(STARTS["png"])


def test_lines_stop_at_a_gap() -> None:
    t = np.array([0.0, 1.0, 2.0, 7.0, 8.0])
    at, y = broken(t, t)
    assert np.isnan(y).tolist() == [False, False, False, True, False, False]
    assert (np.diff(at) >= 0.0).all()
    whole = np.arange(5.0)
    assert broken(whole, whole)[1] is whole


def test_a_flag_of_one_tick_is_seen() -> None:
    axes = Figure().subplots()
    t = np.arange(10_000) / 500.0
    flagged(axes, t, np.zeros(len(t)), "never")
    assert axes.get_legend_handles_labels() == ([], [])
    flagged(axes, t, (t == 7.0).astype(float), "once")
    (mark,) = axes.collections
    assert float(np.asarray(mark.get_linewidth()).min()) > 0.0 and mark.get_paths()


def test_what_a_zoom_cuts_is_said() -> None:
    t = np.arange(10.0)
    y = np.where(t < 2.0, -80.0, np.where(t < 6.0, 1.0, 3.0))
    axes = Figure().subplots()
    zoom(axes, t, [y], 2.0, remark="bounds ±30")
    low, high = axes.get_ylim()
    assert -1.0 < low < 1.0 and 3.0 < high < 4.0
    assert [text.get_text() for text in axes.texts] == ["bounds ±30; before 2 s: to −80"]
