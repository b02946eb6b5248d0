"""MAVProxy on a pseudo-terminal: the session of docs/mavproxy.txt, flown."""

from __future__ import annotations

import re

import pytest

from gcs_tools.studies import console


@pytest.mark.parametrize(
    ("airframe", "link", "port"),
    [
        # by the vehicle's own port: 14550 is shared with every other vehicle on this machine
        ("s1000", "udpout", "fcu_station"), ("quad", "tcp", "fcu_tcp"),
    ],
)  # fmt: skip
def test_a_whole_flight(vehicle, airframe, link, port):
    up = vehicle("--speed", "3", "--airframe", airframe)
    master = f"{link}:127.0.0.1:{getattr(up.ports, port)}"
    said = console.session(master, up.folder, console.whole_flight)
    parameters = int(re.search(r"Received (\d+) parameters", said).group(1))
    saved = next(up.folder.rglob("*.parm"))
    assert parameters == len(saved.read_text().splitlines())
    assert parameters > 50
    modes = re.findall(r"^(?:\w+> )*Mode (\w+)$", said, re.MULTILINE)
    # what the console calls Hold it may show late, or not at all in passing
    assert [mode for mode in modes if mode != "LOITER"] == [
        "TAKEOFF", "POSCTL", "UNKNOWN", "RTL", "LAND",
    ]  # fmt: skip
