"""Histories, what a flight knows at a time, and the thinning of lines."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.pictures.history import FlightHistory, TopicHistory, value
from gcs_tools.pictures.quantities import SHOWN, ShownLimits, kept
from gcs_tools.pictures.view.charts import places, seeded, stretches, thinned
from gcs_tools.recording.reader import RecordingError
from gcs_tools.recording.schema import TOPICS
from gcs_tools.recording.table import Table


def _table(**columns):
    return Table(np.stack(list(columns.values()), axis=1), list(columns))


def test_history_keeps_the_newest_seconds_of_all_that_was_appended():
    history = TopicHistory(["x"], keep_s=2.0)
    t = np.arange(0.0, 30.0, 0.001)
    for batch in np.array_split(t, 977):
        history.append(_table(t=batch, unused=-batch, x=10.0 * batch))
    assert history["t"][0] == pytest.approx(t[-1] - 2.0, abs=1e-9)
    assert history["t"][-1] == t[-1]
    assert len(history) == 2001
    np.testing.assert_array_equal(history["x"], 10.0 * history["t"])


def test_history_grows_as_long_as_everything_is_kept():
    history = TopicHistory([])
    t = np.arange(100_000) * 0.002
    for batch in np.array_split(t, 71):
        history.append(_table(t=batch))
    np.testing.assert_array_equal(history["t"], t)


def test_time_that_goes_back_begins_a_new_flight():
    history = TopicHistory(["x"])
    history.append(_table(t=[1.0, 2.0], x=[1.0, 2.0]))
    history.append(_table(t=[3.0, 0.0, 0.5], x=[3.0, 7.0, 8.0]))
    assert history["t"].tolist() == [0.0, 0.5]
    assert history["x"].tolist() == [7.0, 8.0]


TOLD = {name: topic.columns for name, topic in TOPICS.items()}


def test_all_that_is_shown_of_the_papers_law_is_told_and_kept_once():
    found = kept(TOLD)
    assert sorted(name for names in found.values() for name in names) == sorted(SHOWN)
    assert all(set(names) <= set(TOLD[topic]) for topic, names in found.items())


def test_what_two_tell_under_one_name_is_the_truths():
    told = {"/fcu/law": ["t", "state.v_E.x", "m", "engaged"], "/plant/truth": ["state.v_E.x", "m"]}
    assert kept(told) == {"/plant/truth": ["state.v_E.x", "m"], "/fcu/law": ["engaged"]}


def test_what_rows_do_not_have_is_not_a_number():
    history = TopicHistory(["x", "new"])
    history.append(_table(t=[1.0, 2.0], x=[3.0, 4.0]))
    assert history["x"].tolist() == [3.0, 4.0]
    assert np.isnan(history["new"]).all()


def _append(flight, topic, **columns):
    """Rows of a topic of which only some columns matter; dots of names are underscores here."""
    names = TOPICS[topic].columns
    known = {name.replace(".", "_"): i for i, name in enumerate(names)}
    rows = np.full((len(columns["t"]), len(names)), np.nan)
    for name, column in columns.items():
        rows[:, known[name]] = column
    flight.append(topic, Table(rows, names))


def test_a_moment_has_the_last_row_of_each_topic_by_then():
    flight = FlightHistory("a flight", TOLD)
    assert flight.span is None
    assert np.isnan(flight.value("m", 1.0))
    assert flight.status(1.0) == ""
    _append(flight, "/plant/truth", t=[0.0, 1.0, 2.0], m=[5.0, 6.0, 7.0])
    _append(flight, "/fcu/law", t=[1.0, 2.0], state_estimates_m_hat=[60.0, 70.0])
    _append(flight, "/fcu/status", t=[2.0], status_armed=1.0, status_main_mode=4.0,
            status_sub_mode=6.0, status_failsafe=1.0)  # fmt: skip
    assert flight.span == (0.0, 2.0)
    assert flight.value("m", 1.9) == 6.0
    assert flight.value("m", 2.0 - 1e-7) == 7.0  # the same microsecond
    assert flight.value("state.estimates.m_hat", 1.5) == 60.0
    np.testing.assert_array_equal(
        flight.along(flight.series("m")[0], "state.estimates.m_hat"), [np.nan, 60.0, 70.0]
    )
    assert flight.status(2.5) == "land, armed, failsafe"


def test_the_ground_is_found_under_a_vehicle_that_stands_on_it():
    flight = FlightHistory("a flight", TOLD)
    _append(flight, "/plant/truth", t=[0.0], state_r_E_z=[4.0], on_ground=[0.0])
    assert flight.ground_z is None
    _append(flight, "/plant/truth", t=[0.5], state_r_E_z=[2.3], on_ground=[1.0])
    assert flight.ground_z == pytest.approx(2.0)


def test_a_thinned_line_keeps_its_extremes_and_its_gaps():
    t = np.arange(0.0, 60.0, 0.001)
    y = np.sin(t)
    y[12_345] = 40.0  # one sample
    y[(t > 20.0) & (t < 30.0)] = np.inf  # not drawable
    ends = stretches((t[0], t[-1]), len(t))
    x, thin = places(ends), thinned(t, y, ends)
    assert 300 < len(x) == len(thin) <= 602
    assert (np.diff(x) > 0.0).all()
    assert np.nanmax(thin) == 40.0
    assert x[np.nanargmax(thin)] == pytest.approx(t[12_345], abs=0.25)
    assert np.isnan(thin[(x > 20.3) & (x < 29.7)]).all()
    steady = (x > 31.0) | ((x > 13.0) & (x < 19.0))
    np.testing.assert_allclose(thin[steady], np.sin(x[steady]), atol=0.25)


def test_the_past_is_thinned_the_same_way_while_time_goes_on():
    t = np.arange(0.0, 61.0, 0.002)
    y = np.sin(7.0 * t)
    drawn = []
    for now in (60.0, 60.37):
        shown = (t > now - 60.0) & (t <= now)
        ends = stretches((t[shown][0], now), shown.sum())
        drawn.append(dict(zip(places(ends), thinned(t[shown], y[shown], ends), strict=True)))
    for x in np.intersect1d(list(drawn[0]), list(drawn[1]))[2:-2]:
        assert drawn[0][x] == drawn[1][x]


def test_a_thinned_line_has_nothing_where_there_are_no_rows():
    ends = stretches((0.0, 10.0), 40)
    assert np.isnan(thinned(np.zeros(0), np.zeros(0), ends)).all()
    late = thinned(np.array([9.9]), np.array([3.0]), ends)
    assert np.isnan(late[:-2]).all()
    assert late[-2:].tolist() == [3.0, 3.0]


def test_no_line_begins_with_what_is_not_a_number():
    nan = np.nan
    lines = [np.array(y) for y in ([nan, 3.0, 4.0], [nan, nan, 5.0], [nan] * 3, [7.0, nan, nan])]
    begun = seeded(lines)
    assert [y[0] for y in begun] == [3.0, 3.0, 3.0, 7.0]
    for y, before in zip(begun, lines, strict=True):
        np.testing.assert_array_equal(y[1:], before[1:])
    assert seeded([np.full(3, nan)])[0][0] == 0.0


def test_values_are_those_of_the_last_row_by_then():
    series = np.array([1.0, 2.0]), np.array([10.0, 20.0])
    assert np.isnan(value(series, 0.9))
    assert value(series, 1.9) == 10.0
    assert value(series, 2.0) == 20.0


def test_a_recorded_flight_has_the_limits_that_it_was_flown_with(recording):
    from gcs_tools.pictures.history import recorded

    flight = recorded(recording.path)
    assert flight.limits == ShownLimits.believed()  # paper_nominal changes none
    assert flight.ground_z == -10.0
    assert flight.span == tuple(recording.plant["t"][[0, -1]])


def test_a_recording_without_a_flight_is_refused(tmp_path):
    from gcs_tools.pictures.history import recorded
    from gcs_tools.recording.writer import RecordingWriter

    path = tmp_path / "flight.mcap"
    with RecordingWriter(path, {"title": "nothing"}):
        pass
    with pytest.raises(RecordingError, match="nothing was recorded"):
        recorded(path)
