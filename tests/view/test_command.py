"""`gcs view`: what it says when it can and cannot serve a page."""

from __future__ import annotations

import socket
import urllib.request
from urllib.parse import urlsplit

import pytest

from tests.view.conftest import COMMAND


@pytest.fixture
def taken():
    """`taken(port)`: a port that somebody listens on; 0 for any."""
    sockets = []

    def take(port=0):
        sockets.append(socket.create_server(("127.0.0.1", port)))
        return sockets[-1].getsockname()[1]

    yield take
    for one in sockets:
        one.close()


def _ended(started):
    out, err = started.process.communicate()
    return started.process.returncode, out, err


def test_view_serves_this_machine_alone_and_ends_when_told(recording, gcs_view):
    started = gcs_view(recording.path)
    place = urlsplit(started.url)
    host, port = place.hostname, place.port
    assert host == "127.0.0.1"
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with browser.open(started.url) as answer:
        assert b"<html" in answer.read()
    with pytest.raises(
        ConnectionRefusedError
    ):  # 127.0.0.2 is this machine too, and nobody is there
        socket.create_connection(("127.0.0.2", int(port)))
    started.process.terminate()
    code, out, err = _ended(started)
    assert (code, out, err.strip().splitlines()[-1]) == (0, "", "stopped")


def test_the_next_port_is_taken_if_the_first_is_busy_and_said(recording, gcs_view, taken):
    try:
        taken(8080)
    except OSError:
        pass  # it is busy already
    started = gcs_view(recording.path)
    port = urlsplit(started.url).port
    assert 8080 < port < 8100
    started.process.terminate()
    code, _, err = _ended(started)
    assert code == 0
    assert " 8080 " in err and str(port) in err


def test_a_port_that_is_asked_for_is_not_replaced(recording, gcs_view, taken):
    port = taken()
    code, out, err = _ended(gcs_view(recording.path, "--port", port))
    assert (code, out) == (3, "")
    assert f" {port} " in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "said"), [(None, "No such file"), (b"not a recording", "flight.mcap: ")]
)
def test_a_recording_that_cannot_be_read(tmp_path, gcs_view, content, said):
    path = tmp_path / "flight.mcap"
    if content is not None:
        path.write_bytes(content)
    code, out, err = _ended(gcs_view(path))
    assert (code, out) == (2, "")
    told = err.splitlines()[-1]  # after a word on its port, if another holds that
    assert told.startswith("Error: ")
    assert said in err
    assert "Traceback" not in err


def test_view_says_how_to_install_its_extra(recording, gcs_view):
    absent = f"import sys; sys.modules['viser'] = None; {COMMAND}"
    code, out, err = _ended(gcs_view(recording.path, code=absent))
    assert (code, out) == (3, "")
    assert "pip install viser" in err


def test_a_recording_has_no_instance(recording, gcs_view):
    code, out, err = _ended(gcs_view(recording.path, "--instance", 1))
    assert (code, out) == (2, "")
    assert "--instance" in err
