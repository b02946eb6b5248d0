"""The page in a real browser, against the rows that it shows."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.bus.configured import free_port
from tests.view.conftest import looking, serving
from tests.view.pictures import caption, node, picture, told


@pytest.fixture(scope="module")
def page(recording, browser):
    """For tests that set nothing but the time, each its own."""
    with serving() as gcs_view, looking(browser) as look:
        yield look(gcs_view(recording.path, "--port", free_port()).url).page


@pytest.fixture
def own_page(recording, gcs_view, look):
    """For a test that sets more."""
    return look(gcs_view(recording.path, "--port", free_port()).url, scale=1.0).page


def _go(page, t):
    """Set the slider's time, and wait for the charts to be there too."""
    field = page.locator("input[inputmode]").first
    field.fill(f"{t:g}")
    field.press("Enter")
    page.wait_for_function(
        """t => {
            const said = document.querySelector('[data-told=time] ~ code')?.innerText;
            const charts = Object.values(window.__viserTestpoints.uplots).map(u => u.chart.data);
            return Number(said) === t && charts.every(data => data[0].includes(t));
        }""",
        arg=t,
    )


def test_the_slider_moves_the_vehicle_to_where_it_was(page, recording):
    for t in (0.0, 1.2, 3.4):
        _go(page, t)
        i = round(t * 500)
        plant, tick = (rows.take([i]) for rows in (recording.plant, recording.fcu))
        assert plant["t"][0] == pytest.approx(t, abs=1e-9)
        vehicle = node(page, "/world/vehicle")
        assert vehicle["visible"]
        np.testing.assert_allclose(vehicle["position"], plant["state.r_E"][0], atol=1e-5)
        np.testing.assert_allclose(vehicle["wxyz"], plant["state.q_EB"][0], atol=1e-6)
        np.testing.assert_allclose(  # the vehicle is followed: it stays in the middle
            node(page, "/world")["position"], -plant["state.r_E"][0], atol=1e-5
        )
        np.testing.assert_allclose(
            node(page, "/world/setpoint")["position"],
            tick["setpoint.r_c"][0],
            atol=1e-5,
        )
        np.testing.assert_allclose(
            node(page, "/world/model")["position"], tick["outputs.reference.r_m"][0], atol=1e-5
        )
        assert node(page, "/world/ground")["position"] == [0.0, 0.0, -10.0]


def test_the_numbers_are_those_of_the_recording(page, recording):
    _go(page, 2.5)
    plant, tick = (rows.take([1250]) for rows in (recording.plant, recording.fcu))
    assert told(page, "position")[:3] == plant["state.r_E"][0].round(3).tolist()
    assert told(page, "velocity")[:3] == plant["state.v_E"][0].round(3).tolist()
    assert told(page, "setpoint")[:3] == [4.0, 7.0, 18.0]
    away = plant["state.r_E"][0] - tick["outputs.reference.r_m"][0]
    assert caption(page, "Distance from the reference") == {"": [f"{np.linalg.norm(away):.3f}"]}
    drag = caption(page, "Drag over mass")
    for axis, name in zip("xyz", ("east", "north", "up"), strict=True):
        truth = plant[f"f_D_E.{axis}"][0] / plant["m"][0]
        assert drag[name] == [f"{tick[f'state.estimates.s_v_hat.{axis}'][0]:.2f}", f"{truth:.2f}"]
    assert caption(page, "Mass") == {
        "estimate": [f"{tick['state.estimates.m_hat'][0]:.2f}", "8.00"]
    }
    assert caption(page, "Thrust")["commanded"][0] == f"{tick['outputs.T_c'][0]:.1f}"
    roll, pitch = np.degrees(tick["outputs.angles_c"][0, :2])
    assert caption(page, "Commanded tilt") == {"roll": [f"{roll:.1f}"], "pitch": [f"{pitch:.1f}"]}
    wind = caption(page, "Wind")
    estimate = recording.reports["/fcu/wind"]["wind.v_air_E"][1250]
    assert wind["east"] == [f"{estimate[0]:.2f}", f"{plant['v_air_E.x'][0]:.2f}"]
    assert wind["up"] == ["–", f"{plant['v_air_E.z'][0]:.2f}"]


def _chart(page, title):
    """What uPlot holds of the chart whose first line is called so: rows of numbers, and a scale."""
    return page.evaluate(
        """title => {
            const all = Object.values(window.__viserTestpoints.uplots).map(u => u.chart);
            const chart = all.find(c => c.series.some(s => s.label === title));
            const rows = Array.from(chart.data, row => Array.from(row));
            return {labels: chart.series.map(s => s.label), rows: rows, y: [chart.scales.y.min, chart.scales.y.max]};
        }""",
        title,
    )


def test_lines_have_the_extremes_of_the_recording_and_a_mark_at_the_time(page, recording):
    _go(page, 2.5)
    mass = _chart(page, "estimate")
    rows = dict(zip(mass["labels"], map(np.array, mass["rows"]), strict=True))
    m_hat = recording.fcu["state.estimates.m_hat"]
    assert [rows["estimate"].min(), rows["estimate"].max()] == [m_hat.min(), m_hat.max()]
    assert mass["y"][0] < m_hat.min()
    assert mass["y"][1] > m_hat.max()
    assert (rows["estimate, truth"] == 8.0).all()
    marked = np.isfinite(rows["now"].astype(float))
    assert rows["t, s"][marked].tolist() == [2.5, 2.5]
    thrust = _chart(page, "commanded")
    limits = [
        row for label, row in zip(thrust["labels"], thrust["rows"], strict=True) if label == "limit"
    ]
    assert [set(row) for row in limits] == [{5.0}, {200.0}]
    tilt = _chart(page, "pitch")
    assert tilt["rows"][-2][0] == pytest.approx(45.0)


def test_the_scene_is_drawn_and_changes_with_time(own_page):
    page = own_page
    _go(page, 0.5)
    page.get_by_text("Follow").locator("xpath=following::input[1]").uncheck()
    early = picture(page)
    assert len(np.unique(early.reshape(-1, 3), axis=0)) > 500  # sky, ground, vehicle, lines
    assert (early.max(axis=2) < 60).sum() > 100  # its arms are dark, nothing else is
    _go(page, 1.6)
    assert (np.abs(picture(page).astype(int) - early).max(axis=2) > 30).sum() > 500


TIME = "Number(document.querySelector('[data-told=time] ~ code')?.innerText)"


@pytest.mark.alone
def test_play_goes_to_the_end_and_stands_still(own_page, recording):
    page = own_page
    play = page.get_by_role("button", name=re.compile("^Play$"))
    pause = page.get_by_role("button", name=re.compile("^Pause$"))
    end = round(recording.plant["t"][-1], 3)
    page.get_by_role("combobox").click()
    page.get_by_role("option", name="0.25").click()  # slower than the slowest browser
    play.click()
    pause.wait_for()
    page.wait_for_function(f"{TIME} > 0.2")
    pause.click()
    play.wait_for()
    assert page.evaluate(TIME) < end
    _go(page, end - 0.3)
    play.click()
    last = recording.plant["state.r_E"][-1]
    # the scene passes over a move of less than a hundred-thousandth of where the vehicle is
    page.wait_for_function(
        """last => window.__viserMutable.nodeRefFromName['/world/vehicle'].position.toArray().every(
            (x, i) => Math.abs(x - last[i]) <= 1.1e-5 * Math.abs(last[i]))""",
        arg=last.tolist(),
    )
    play.wait_for()
    assert page.evaluate(TIME) == end
    play.click()  # from the start again
    page.wait_for_function(f"{TIME} < {end - 0.3}")
