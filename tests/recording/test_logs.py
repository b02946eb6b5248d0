"""Log lines of a run become events, those that are none do not."""

from gcs_tools.recording.events import Event, logged


def test_lines_of_both_processes_become_events(tmp_path):
    (tmp_path / "fcu.log").write_text(
        "         - info    fcu  instance 0: waiting for the plant\n"
        "    12.500 warning fcu  Setpoint refused: nan\n"
        "Traceback (most recent call last):\n"
    )
    (tmp_path / "plant.log").write_text(
        "    20.000 error   plant the flight ended: hit the ground\n"
    )
    assert list(logged(tmp_path)) == [
        Event(0.0, "info", "fcu: instance 0: waiting for the plant"),
        Event(12.5, "warning", "fcu: Setpoint refused: nan"),
        Event(20.0, "error", "plant: the flight ended: hit the ground"),
    ]


def test_a_flight_without_logs_has_no_events(tmp_path):
    assert list(logged(tmp_path)) == []
