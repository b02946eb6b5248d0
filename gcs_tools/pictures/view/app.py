"""The page of a flight and the loop that keeps it current."""

from __future__ import annotations

import io
import math
import socket
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from types import TracebackType
from typing import Any, Self

import viser

from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.quantities import QUANTITIES
from gcs_tools.pictures.view import page
from gcs_tools.pictures.view.admission import Admission, new_secret
from gcs_tools.pictures.view.charts import Plot
from gcs_tools.pictures.view.scene import Scene

HOST = "127.0.0.1"  # never another
PORTS = 20  # that are tried, one after the other, if none is asked for
FRAME_S = 0.05  # of the scene
CHARTS_EVERY = 4  # frames, while time runs
CHARTS_PX, PANEL_PX = 500, 300
SPEEDS = ("0.25", "0.5", "1", "2", "4")


class NoPort(Exception):
    """No port to serve on: names those that are in use."""


class PortTaken(NoPort):
    """One port is in use."""

    def __init__(self, port: int) -> None:
        super().__init__(f"port {port} of {HOST} is in use (another: --port N)")


def free_port(wanted: int | None, first: int) -> int:
    """`wanted`, or from `first` on one that nobody has. Raises NoPort."""
    tried = range(first, first + PORTS) if wanted is None else range(wanted, wanted + 1)
    for port in tried:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server will
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    if wanted is not None:
        raise PortTaken(wanted)
    raise NoPort(f"ports {tried[0]} to {tried[-1]} of {HOST} are all in use (another: --port N)")


def on_free_port(wanted: int | None, first: int, show: Callable[[int], None]) -> None:
    """Call `show` with `wanted`, or with the first port from `first` on that nobody has.

    A port that another program takes between the look and the start of the server is passed over.
    Raises NoPort.
    """
    while True:
        port = free_port(wanted, first)
        try:
            return show(port)
        except PortTaken:
            if wanted is not None:
                raise
            first = port + 1


class App:
    """A page that shows one flight, served until `stop`."""

    def __init__(
        self, flight: FlightHistory, port: int, *, whole: bool, secret: str | None = None
    ) -> None:  # fmt: skip
        """whole : the flight is over; the page has a slider of time.  secret : what `url` holds, and
        who opens the page must know; None: a new one. Raises PortTaken.
        """
        self._flight, self._whole = flight, whole
        secret = secret or new_secret()
        admission = Admission(port, secret)
        with redirect_stdout(io.StringIO()), admission.installed():  # it greets, verbose or not
            self._server = viser.ViserServer(HOST, port, verbose=False)
        if self._server.get_port() != port:  # taken since it was free
            self.stop()
            raise PortTaken(port)
        self.url = f"http://{HOST}:{port}/?token={secret}"
        self.gone = False  # whether the vehicle of a live flight has left
        self._now = flight.span[0] if flight.span else 0.0
        self._shown: tuple[float, bool, str] | None = None
        self._frames = 0
        self._frame = time.monotonic()  # when the last began
        self._late = False
        self._knew_plan = self._has_plan
        with self._server.atomic():
            self._camera()
            self._controls()
            self._plots = [*self._charts()]
            self._scene = Scene(self._server.scene, flight, whole=whole)
        self._draw()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def _camera(self) -> None:
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = (-6.5, -8.5, 5.2), (0.0, 0.0, 0.0), 0.9
        self._server.gui.configure_theme(
            show_logo=False,
            show_share_button=False,
            control_width="small",
            brand_color=(0, 114, 178),
        )

    def _controls(self) -> None:
        gui = self._server.gui
        gui.set_panel_label("gcs view")
        self._heading = gui.add_html(page.heading(self._flight.title, self._kind))
        self._told = gui.add_html("")
        self._playing = False
        self._follow = gui.add_checkbox("Follow", True, hint="Keep the vehicle in the middle")
        if self._whole and self._flight.span is not None:
            first, last = self._flight.span
            self._slider: Any = gui.add_slider("Time, s", first, last, 0.001, first)
            self._set = first  # what the slider was last seen at
            self._sent: set[float] = set()  # that it was played to: a browser may say one again
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
            self._button = gui.add_button("Play")
            self._button.on_click(lambda _: self._press())
        self._key = gui.add_html(page.key(self._has_plan))
        gui.main_panel.float(x=15, y=15, width=PANEL_PX)

    @property
    def _has_plan(self) -> bool:
        """Tell whether the flight has or had a plan or a fence."""
        return self._flight.plans.has_any

    @property
    def _kind(self) -> str:
        """Whether the flight is live, and what the vehicle does at the present time."""
        if self._flight.span is None:
            return "live: waiting for a vehicle"
        kind = "recording" if self._whole else "gone, last" if self.gone else "live"
        status = self._flight.status(self._now)
        return f"{kind}: {status}" if status else kind.removesuffix(", last")

    def _charts(self) -> list[Plot]:
        plots: list[Plot] = []
        shown = [q for q in QUANTITIES if q.tab and self._flight.shows(q)]
        if not shown:
            return plots
        panel = self._server.gui.add_panel()
        for tab in dict.fromkeys(q.tab for q in shown):
            charts = [q for q in shown if q.tab == tab]
            with panel.add_tab(tab):
                for chart in charts:
                    last = chart is charts[-1]
                    plot = Plot(self._server.gui, chart, self._flight, whole=self._whole, last=last)
                    plots.append(plot)
        panel.dock_right()
        panel.set_width(CHARTS_PX)
        return plots

    def _press(self) -> None:
        """Play or pause; at the end, play from the start."""
        assert self._flight.span is not None
        first, last = self._flight.span
        if not self._playing and self._now >= last:
            self._now = first
            self._send(first)
        self._playing = not self._playing

    def run(self) -> None:
        """Keep the page of a flight that is over current, until interrupted."""
        while True:
            self.frame()

    def frame(self) -> None:
        """Draw what has changed, and wait for the time of the next frame."""
        now = time.monotonic()
        self.step(now - self._frame)
        self._frame = now
        time.sleep(max(0.0, now + FRAME_S - time.monotonic()))

    def step(self, elapsed: float) -> None:
        """Let `elapsed` (s, wall) go by, and draw what has changed."""
        if self._flight.span is None:
            return
        if self._whole:
            self._play(elapsed)
        else:
            self._now = self._flight.span[1]
        self._draw()

    def _play(self, elapsed: float) -> None:
        """Follow the slider, and move it while the flight is played."""
        assert self._flight.span is not None
        first, last = self._flight.span
        at = self._slider.value  # read once: an echo may come at any time
        if at in self._sent:  # an echo of a slow browser
            self._slider.value = self._set
        elif at != self._set:  # moved by hand
            self._set = self._now = min(max(at, first), last)
        if self._playing:
            self._now = min(last, self._now + elapsed * float(self._speed.value))
            self._send(self._now)
            if self._now >= last:
                self._playing = False
        label = "Pause" if self._playing else "Play"
        if self._button.label != label:
            self._button.label = label

    def _send(self, t: float) -> None:
        """Move the slider to t, by a hair from where a hand would: an echo is not a hand's.

        A hand moves it in milliseconds and to both ends; the clock meets neither but at the ends.
        """
        assert self._flight.span is not None
        first, last = self._flight.span
        self._set = min(max(t, math.nextafter(first, last)), math.nextafter(last, first))
        self._sent.add(self._set)
        self._slider.value = self._set

    def _draw(self) -> None:
        """Draw the flight at the present time, unless that is what the page shows already."""
        flight, runs = self._flight, self._playing or not self._whole
        shown = (self._now, self._follow.value, self._kind)
        if shown == self._shown and not self._late:
            return
        self._frames += 1
        self._late = runs and self._frames % CHARTS_EVERY != 0  # its charts are not current
        with self._server.atomic():
            if self._shown is None or shown[2] != self._shown[2]:
                self._heading.content = page.heading(flight.title, self._kind)
            self._told.content = page.told(flight, self._now)
            if self._has_plan != self._knew_plan:
                self._knew_plan = self._has_plan
                self._key.content = page.key(self._knew_plan)
            self._scene.show(self._now, self._follow.value)
            if not self._late and flight.span is not None:
                for plot in self._plots:
                    plot.show(self._now)
        self._shown = shown

    def stop(self) -> None:
        """Stop serving; pages that are open say that they have lost it."""
        with redirect_stdout(io.StringIO()):  # and says good-bye
            self._server.stop()
