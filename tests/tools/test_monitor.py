"""The monitor shows what is on the bus: its numbers, and its picture."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text

from gcs_tools.pictures.monitor.widgets import gauge, spark


def plain(text: Text) -> str:
    with Console(width=80).capture() as _:
        return text.plain


def test_numbers_of_the_monitor_are_the_flights(recording, replay, tool):
    # half a minute of the wall for three seconds: it is still there when a busy machine looks
    replay("--from", "3", "--speed", "0.1", "--wait")
    seen = tool("monitor", "--after", "0.2")
    k = int(np.searchsorted(recording.plant["t"], seen["time_s"] - 1e-6))
    assert seen["position_m"] == recording.plant["state.r_E"][k].tolist()
    assert seen["wind_m_s"] == recording.plant["v_air_E"][k].tolist()
    # the flight controller's answer to a tick may be in the next sample
    ticks = recording.fcu.take(slice(max(k - 40, 0), k + 41))
    assert seen["reference_m"] in ticks["outputs.reference.r_m"].tolist()
    assert seen["mass_kg"] in ticks["state.estimates.m_hat"].tolist()
    assert seen["thrust_N"] in ticks["outputs.T_c"].tolist()
    assert seen["margin_N"] in ticks["guard.margin.force"].tolist()
    assert seen["margin_condition_N"] in ticks["guard.margin.condition"].tolist()
    assert seen["governed"] in ticks["guard.governed"].tolist()
    r, r_m = recording.plant["state.r_E"], recording.fcu["outputs.reference.r_m"]
    off = np.linalg.norm(r - r_m, axis=1)[max(k - 40, 0) : k + 41]
    assert np.abs(off - seen["off_reference_m"]).min() < 1e-9
    assert (seen["alive"], seen["lost"]) == (["fcu", "plant", "publisher"], {})
    assert recording.fcu["t"][k] == recording.plant["t"][k]


@pytest.mark.parametrize(("columns_", "lines"), [(150, 45), (100, 30), (60, 20)])
def test_picture_of_the_monitor_fits_the_terminal(replay, start, instance, columns_, lines):
    import os

    replay("--speed", "0.25", "--wait")
    size = {"COLUMNS": str(columns_), "LINES": str(lines)}
    program = start("gcs_tools", "monitor", "--once", "--instance", instance, env=os.environ | size)
    assert program.wait() == 0, program.text()
    picture = program.out.read_text()
    assert all(len(line) <= columns_ for line in picture.splitlines())
    for title in ("The paper's flight", "Tracking", "thrust"):
        assert title in picture or columns_ < 100


def test_a_picture_on_file(replay, start, instance, tmp_path):
    replay("--speed", "1", "--wait")
    program = start("gcs_tools", "monitor", "--svg", tmp_path / "m.svg", "--instance", instance)
    assert program.wait() == 0, program.text()
    assert "Estimates" in (tmp_path / "m.svg").read_text()


@pytest.mark.parametrize(("seconds", "least", "most"), [(1, 1.0, 2.9), (10, 2.9, 3.0)])
def test_monitor_watches_for_its_time_or_until_the_flight_ends(replay, tool, seconds, least, most):
    """Seconds of simulation time, of a flight that ends at 3 s and is slow, so that a busy machine keeps up."""
    replay("--speed", "0.25", "--wait", "--to", "3")
    assert least <= tool("monitor", "--for", seconds, "--timeout", 60)["time_s"] <= most


def test_monitor_waits_for_a_vehicle_as_long_as_it_is_to_watch(start, instance):
    program = start("gcs_tools", "monitor", "--for", "0.2", "--instance", instance)
    assert program.wait() == 3
    program.says("did not publish within 0.2 s")


def test_monitor_waits_for_a_vehicle_and_ends_on_request(start, instance):
    program = start("gcs_tools", "monitor", "--instance", instance)
    program.says(f"waiting for instance {instance} to publish")
    assert program.interrupted() == 130  # off a terminal it would be a single picture


def test_a_mark_stands_where_the_value_is_and_is_red_at_a_limit():
    for value, at, near in ((0.0, 1, True), (50.0, 5, False), (100.0, 9, True), (170.0, 9, True)):
        drawn = gauge(value, 0.0, 100.0, 11)
        assert (len(drawn.plain), drawn.plain.index("●")) == (11, at)
        assert ("red" in str(drawn.spans)) == near
    assert "●" not in gauge(float("nan"), 0.0, 100.0, 11).plain


def test_a_sparkline_shows_the_greatest_of_each_stretch():
    t = np.linspace(0.001, 30.0, 3000)
    values = np.where((t > 14.0) & (t < 14.1), 7.0, 0.0)
    drawn = spark(t, values, 30).plain
    assert drawn.index("█") == 14 and drawn.count("█") == 1 and set(drawn) == {"█", "▁"}
    assert spark(t[:0], values[:0], 4).plain == "    "
