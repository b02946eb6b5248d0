"""A recording, the page of it, and a browser that has no network to look at it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from gcs_tools.flight.run import fly
from gcs_tools.recording.reader import read
from tests.patience import PATIENCE_S
from tests.process.conftest import start_process

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# the last: whatever the page or the browser itself would ask of the outside fails
OPTIONS = [
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]  # fmt: skip
COMMAND = "from gcs_tools.__main__ import main; main(prog_name='gcs')"


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    """The first seconds of the paper's flight, and where they are."""
    folder = tmp_path_factory.mktemp("flight")
    fly(
        "paper_nominal", in_process=True, out=folder / "run", settings=["flight.duration_s=8"],
        figure="never",
    )  # fmt: skip
    return read(folder / "run" / "flight.mcap")


@pytest.fixture(scope="session")
def browser():
    """Chromium, as the system has it."""
    path = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if path is None:
        pytest.fail("these tests look at the page in Chromium, and there is none: install the"
                    " system's package of it (Debian: apt-get install chromium)")  # fmt: skip
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=OPTIONS)
        yield started
        started.close()


@contextmanager
def looking(browser):
    """`look(url)`: the page, once it shows a vehicle; it must have no errors and ask nobody else.

    It is drawn in software: of a page whose pixels nobody looks at, a quarter of them are enough.
    """
    contexts = []

    def at(url, scale=0.5):
        context = browser.new_context(
            viewport={"width": 1280, "height": 640}, device_scale_factor=scale
        )
        context.set_default_timeout(1000.0 * PATIENCE_S)
        page = context.new_page()
        seen = SimpleNamespace(page=page, url=url, requests=[], errors=[])
        contexts.append((context, seen))
        context.on("request", lambda request: seen.requests.append(request.url))
        page.on("websocket", lambda socket: seen.requests.append(socket.url))
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
        page.goto(url)
        page.wait_for_function(
            "window.__viserMutable?.nodeRefFromName?.['/world/vehicle/disc_8'] != null"
        )
        return seen

    yield at
    for context, seen in contexts:
        context.close()
        assert seen.errors == []
        page = seen.url.partition("/?")[0]
        own = (page, page.replace("http:", "ws:"), "data:", f"blob:{page}")
        assert len(seen.requests) >= 2
        assert [url for url in seen.requests if not url.startswith(own)] == []


@pytest.fixture
def look(browser):
    """As of `looking`."""
    with looking(browser) as look:
        yield look


@contextmanager
def serving():
    """`gcs_view(*arguments)`: the command; its `url` once it serves, else None."""
    started = []

    def run(*arguments, code=COMMAND):
        process = start_process(
            [sys.executable, "-c", code, "view", "--no-open", *map(str, arguments)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONWARNINGS": "error"},
        )  # fmt: skip
        started.append(process)
        line = process.stdout.readline()
        return SimpleNamespace(process=process, url=line.split()[0] if line else None)

    yield run
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.communicate()


@pytest.fixture
def gcs_view():
    """As of `serving`."""
    with serving() as gcs_view:
        yield gcs_view
