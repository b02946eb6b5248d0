"""What diagnostics cost a tick, and how soon a tick is with who listens: figures of `make bench`."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from gcs_tools.studies.bench.figure import Figure

FLIGHT_S = 20.0  # in real time
ROWS, BURST = 4096, 32  # reported, and between two pauses
PAUSE_S = 0.01  # for the publisher to take them
PUBLISHED_S = 10.0  # wall: until a publisher is there


def figures() -> Iterator[Figure]:
    """All of them, in about a minute."""
    yield from costs()
    for rate_hz in (500, 1000):
        yield from heard(rate_hz)


def costs() -> Iterator[Figure]:
    """What a report costs the control thread after its answer is on its way."""
    from fcu.interface.publisher_feed import SUPPORTED
    from gcs_tools.flight.processes import PORTS, claimed

    with claimed(None, *PORTS) as instance:
        alone = _reports(instance)
        yield Figure("report_us", "report of a tick, nobody publishes (us)", alone * 1e6)
        if not SUPPORTED:
            return
        publish = [sys.executable, "-m", "gcs_tools", "publish", "--instance", str(instance)]
        pipe = subprocess.PIPE
        with subprocess.Popen(publish, stdout=pipe, stderr=subprocess.DEVNULL, text=True) as child:
            try:
                assert child.stdout is not None
                if "ready" not in child.stdout.readline():
                    raise RuntimeError(f"no publisher: `{' '.join(publish)}` says why")
                published = _reports(instance)
            finally:
                child.terminate()
        label = "report of a tick, a publisher takes it (us)"
        yield Figure("report_published_us", label, published * 1e6)
        label = "  of which for the publisher (us)"
        yield Figure("publish_us", label, (published - alone) * 1e6, "5")


def _reports(instance: int) -> float:
    """Median of a Reporter.report, s; with a publisher if there is one."""
    import numpy as np

    from fcu.interface.publisher_feed import PublisherFeed
    from fcu.interface.recorder_pipe import RecorderPipe
    from fcu.laws import loader
    from fcu.parameters import Parameters
    from fcu.process.configuration import read_airframe, read_settings
    from fcu.process.reporting import Reporter, row_width
    from fcu.vehicle.state_machine import StateMachine

    law = loader.load()
    params = Parameters(read_settings(law, None, 500.0), instance + 1, None)
    vehicle, feed = StateMachine(params), PublisherFeed(instance, "fcu", law.identity)
    reporter = Reporter(law, RecorderPipe(row_width(law)), feed, read_airframe(law).drag)
    reporter.warm_up(np.zeros(reporter.width))
    reporter.idle(0.0, params.settings, time.monotonic())
    taken, times = [], np.zeros((1, 3))
    for i in range(ROWS):
        if i % BURST == 0:
            time.sleep(PAUSE_S)
        rows = reporter.tape.free()[:1]
        rows[0, 0] = i * params.law.h
        began = time.perf_counter()
        reporter.report(rows, times, vehicle, 0.0, 0, 0)
        taken.append(time.perf_counter() - began)
    feed.close()
    if feed.dropped:
        raise RuntimeError(f"the publisher had no room for {feed.dropped} of {ROWS} rows")
    return statistics.median(taken)


def heard(rate_hz: int) -> Iterator[Figure]:
    """A flight in real time, and a subscriber that records it: how old ticks are when they come."""
    from gcs_tools.flight.processes import PORTS, claimed

    with claimed(None, *PORTS) as instance:
        pass  # it is free: the flight below claims it
    with tempfile.TemporaryDirectory() as name:
        which = ["--instance", str(instance)]
        gcs, folder = [sys.executable, "-m", "gcs_tools"], Path(name)
        record = [*gcs, "record", str(folder / "bus.mcap"), "--json", *which]
        rate = ["--speed", "1", "--rate", str(rate_hz), "--set", f"flight.duration_s={FLIGHT_S:g}"]
        fly = [*gcs, "fly", "paper_nominal", *rate, "--out", str(folder / "run"), *which]
        pipe, devnull = subprocess.PIPE, subprocess.DEVNULL
        with subprocess.Popen(record, stdout=pipe, stderr=pipe, text=True) as recorder:
            assert recorder.stderr is not None and recorder.stdout is not None
            recorder.stderr.readline()  # it waits for a vehicle
            subprocess.run(fly, stdout=devnull, stderr=devnull, check=False)
            said = json.loads(recorder.stdout.read())
    what = f"real time at {rate_hz} Hz, from a tick to a subscriber"
    for p in ("p50", "p99"):
        value = said[f"latency_{p}_s"] * 1e3
        yield Figure(f"latency_{rate_hz}hz_{p}_ms", f"{what}, {p} (ms)", value)
    ticks = round(FLIGHT_S * rate_hz)
    label = f"real time at {rate_hz} Hz, of {ticks} ticks not recorded from the bus"
    yield Figure(f"lost_{rate_hz}hz_ticks", label, ticks - said["ticks"], "0")
