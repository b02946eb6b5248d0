"""A flight that is still going on: rows arrive, and the page follows them."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.view.app import App, free_port
from gcs_tools.recording.schema import TICK_TOPICS, TOPICS, TRUTH, WIND
from gcs_tools.recording.table import Table
from tests.process.conftest import claimed_instance, start_process
from tests.view.pictures import node, told


@pytest.fixture
def app():
    flight = FlightHistory("under test", {name: topic.columns for name, topic in TOPICS.items()})
    shown = App(flight, free_port(None, 8200), whole=False)
    shown.flight = flight
    yield shown
    shown.stop()


def _receive(flight, recording, rows):
    """Append a part of a recording, a topic at a time, as a bus delivers it."""
    flight.append(TRUTH, recording.plant.take(rows))
    for topic in TICK_TOPICS:
        flight.append(topic.name, recording.fcu.take(rows))
    flight.append(WIND, recording.reports[WIND].take(rows))


def test_the_page_waits_for_a_vehicle_and_then_follows_it(app, recording, look):
    page = look(app.url).page
    page.get_by_text("waiting for a vehicle").wait_for()
    assert not node(page, "/world/vehicle")["visible"]
    for start in range(0, 2000, 25):  # 20 Hz
        _receive(app.flight, recording, slice(start, start + 25))
        app.step(0.05)
    t = recording.plant["t"][1999]
    page.wait_for_function(
        "t => Number(document.querySelector('[data-told=time] ~ code')?.innerText) === t",
        arg=round(t, 3),
    )
    r_E = recording.plant["state.r_E"][1999]
    np.testing.assert_allclose(node(page, "/world/vehicle")["position"], r_E, atol=1e-5)
    assert told(page, "position")[:3] == np.round(r_E, 3).tolist()
    page.get_by_text("waiting for a vehicle").wait_for(state="detached")
    assert page.locator("input[inputmode]").count() == 0  # there is no slider of time
    page.wait_for_function(
        """t => Object.values(window.__viserTestpoints.uplots).every(
            u => Math.abs(u.chart.scales.x.max - t) < 0.1 && Number.isFinite(u.chart.scales.y.min))""",
        arg=t,
    )


def test_a_vehicle_that_begins_anew_is_shown_anew(app, recording, look):
    page = look(app.url).page
    _receive(app.flight, recording, slice(0, 1500))
    app.step(0.05)
    _receive(app.flight, recording, slice(0, 100))
    for _ in range(4):  # charts are drawn every few frames
        app.step(0.05)
    page.wait_for_function(
        "t => Number(document.querySelector('[data-told=time] ~ code')?.innerText) === t",
        arg=round(recording.plant["t"][99], 3),
    )
    assert app.flight.span == (recording.plant["t"][0], recording.plant["t"][99])


def test_a_law_without_a_reference_model_has_no_chart_of_it(app, recording, look):
    page = look(app.url).page
    without = recording.fcu.rows.copy()
    for i, name in enumerate(recording.fcu.names):
        if name.startswith("outputs.reference."):
            without[:, i] = np.nan
    _receive(app.flight, replace(recording, fcu=Table(without, recording.fcu.names)), slice(0, 500))
    for _ in range(4):  # charts are drawn every few frames
        app.step(0.05)
    page.locator('[data-chart="Thrust"]').wait_for()
    page.locator('[data-chart="Distance from the reference"]').wait_for(state="hidden")
    assert not node(page, "/world/model")["visible"]
    _receive(app.flight, recording, slice(500, 525))
    for _ in range(4):
        app.step(0.05)
    page.locator('[data-chart="Distance from the reference"]').wait_for()


@pytest.fixture
def replayed(recording):
    """The instance as which a recording is put onto Zenoh as soon as somebody listens."""
    with claimed_instance() as instance:
        process = start_process(
            [sys.executable, "-m", "gcs_tools", "replay", str(recording.path), "--wait",
             "--instance", str(instance)],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stderr.readline().startswith("replaying")
        yield instance
        process.send_signal(signal.SIGTERM)
        process.communicate()


def test_a_vehicle_on_the_bus_is_shown_until_it_is_gone(recording, replayed, gcs_view, look):
    page = look(gcs_view("--instance", replayed).url).page
    page.get_by_text("gone").wait_for()
    page.wait_for_function(
        "t => Number(document.querySelector('[data-told=time] ~ code')?.innerText) === t",
        arg=round(recording.plant["t"][-1], 3),
    )
    r_E = recording.plant["state.r_E"][-1]
    # the scene passes over a move of less than a hundred-thousandth of where the vehicle is
    np.testing.assert_allclose(node(page, "/world/vehicle")["position"], r_E, rtol=1.1e-5)


def test_what_a_slow_browser_says_again_is_no_move_by_hand(recording):
    flight = FlightHistory("under test", {name: topic.columns for name, topic in TOPICS.items()})
    _receive(flight, recording, slice(0, 2000))
    app = App(flight, free_port(None, 8200), whole=True)
    slider, end = app._slider, flight.span[1]
    try:
        app._press()
        app.step(1.0)
        passed = slider.value
        for _ in range(2):  # pause, play
            app._press()
            app.step(0.0)
        app.step(0.5)
        for said_again in (passed, slider.value):
            slider.value = said_again
            app.step(0.5)
        assert slider.value == pytest.approx(flight.span[0] + 2.5)
        app.step(end)
        at_the_end = slider.value
        app._press()
        app.step(0.1)
        slider.value = at_the_end
        app.step(0.1)
        assert slider.value == pytest.approx(flight.span[0] + 0.2)
        slider.value = end  # by hand
        app.step(0.0)
        assert slider.value == pytest.approx(end)
    finally:
        app.stop()
