"""A Zenoh router on a port of loopback, until it is ended: `python -m tests.bus.router PORT`."""

from __future__ import annotations

import json
import signal
import sys

import zenoh


def main(port: str) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    with zenoh.open(config):
        print("routes", flush=True)
        signal.pause()


if __name__ == "__main__":
    main(*sys.argv[1:])
