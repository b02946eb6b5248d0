"""A flight of a law that learns nothing and has no reference model is shown with what it tells."""

from __future__ import annotations

import io
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from fcu.kernel.buffers import size
from fcu.kernel.rows import column
from fcu.laws import loader
from gcs_tools.cli.program import main
from gcs_tools.live.samples import Sample, describe, described
from gcs_tools.pictures.follower import Follower
from gcs_tools.pictures.history import recorded
from gcs_tools.pictures.monitor.readings import Readings
from gcs_tools.pictures.monitor.screen import screen
from gcs_tools.pictures.plot.overview import flight_figure
from gcs_tools.pictures.quantities import QUANTITIES
from gcs_tools.recording.layout import encode
from gcs_tools.recording.reader import LAW, read
from gcs_tools.recording.schema import FCU, PARAMS, TRUTH, Kinds
from gcs_tools.recording.writer import RecordingWriter
from sitl_plant.physics.types import PlantRecord

N, RATE_HZ = 3000, 500.0
SHOWN = {"Position", "Thrust", "Commanded tilt"}


class Flight:
    """Six seconds of the plain cascade, made up: 80 N, 3 degrees of roll, a metre off to the east."""

    def __init__(self) -> None:
        law = loader.load(Path(__file__).with_name("plain_cascade.py"))
        tick, settings = (
            law.ticks.Tick,
            law.settings.Settings,
        )
        self.kinds = Kinds(tick, settings, PlantRecord)
        self.plant = np.zeros((N, size(PlantRecord)))
        self.fcu, self.params = np.zeros((N, size(tick))), np.ones(size(settings))
        self.plant[:, 0] = self.fcu[:, 0] = np.arange(N) / RATE_HZ
        for name, value in {"state.r_E.x": 1.0, "state.v_E.x": 5.0, "m": 8.0}.items():
            column(PlantRecord, self.plant, name)[:] = value
        for name, value in {
            "engaged": 2.0, "outputs.T_c": 80.0, "outputs.angles_c.x": np.radians(3.0),
            "outputs.reference": np.nan, "outputs.e_r": np.nan,
            "state.v_E.x": -7.0,  # its own, under the name of the truth's
        }.items():  # fmt: skip
            column(tick, self.fcu, name)[:] = value
        limits = {"law.limits.T_min": 5.0, "law.limits.T_max": 200.0, "law.limits.phi_star": 0.7,
                  "law.rotors.f_min": 0.5}  # fmt: skip
        for name, value in limits.items():
            column(settings, self.params[None, :], name)[:] = value

    def write(self, path: Path, metadata: dict[str, str]) -> Path:
        with RecordingWriter(path, metadata, self.kinds) as recorder:
            recorder.set_params(self.params)
            recorder.add_plant(self.plant)
            recorder.add_fcu(self.fcu)
        return path

    def samples(self) -> list[tuple[str, Sample]]:
        """Every topic of the law, and the truth, as they come over the bus."""
        found = []
        kinds: dict[str, Any] = {TRUTH: (self.kinds.record, self.plant)}
        for name, topic in self.kinds.topics.items():
            if name == PARAMS:
                rows = np.concatenate([[0.0], self.params])[None, :]
            elif name == TRUTH or topic.row == FCU:
                kind, whole = kinds.get(name, (self.kinds.tick, self.fcu))
                columns = [column(kind, whole, each) for each in topic.columns]
                rows = np.stack(columns, axis=1)
            else:
                continue
            sequence = np.arange(len(rows), dtype=np.uint64)
            found.append((name, Sample(sequence, sequence, encode(topic.layout, rows))))
        return found


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight()


# without its law's name, what the paper's law tells is filled up with what is not a number
@pytest.fixture(params=[{LAW: "plain_cascade", "title": "Plain."}, {"title": "Plain."}])
def run(request: Any, flight: Flight, tmp_path: Path) -> Path:
    return flight.write(tmp_path / "flight.mcap", request.param)


@pytest.fixture
def readings(flight: Flight) -> Readings:
    """Of a vehicle on the bus that says itself what it tells."""
    vehicle = SimpleNamespace(
        about={"vehicle": "1"}, topics=described(describe(flight.kinds.topics)), alive={"fcu"},
        latest=flight.samples, take=list, counted={}, unknown=0, gone=False,
    )  # fmt: skip
    return Readings(Follower(vehicle))


def test_a_recording_shows_what_ever_has_a_value(run: Path) -> None:
    shown = recorded(run)
    assert {q.title for q in QUANTITIES if shown.shows(q)} == SHOWN
    assert shown.value("state.v_E.x", 0.5) == 5.0
    assert shown.limits.T_max == 200.0
    assert np.isnan(shown.value("state.estimates.m_hat", 0.5))
    assert len(shown.series("position_error")[0]) == N
    assert np.isnan(shown.flown("position_error")[1]).all()


@pytest.mark.computes
def test_figures_that_have_nothing_to_show_are_not_drawn(run: Path) -> None:
    done = CliRunner().invoke(main, ["plot", str(run), "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    drawn = {name for name, of in found.items() if of["path"] is not None}
    assert drawn == {"flight", "tracking", "limits"}
    assert {path.stem for path in run.parent.glob("*.png")} == {f"flight-{name}" for name in drawn}
    said = "no reference model; off the setpoint, settled RMS 1 m; at the end 1 m off the setpoint"
    assert found["tracking"]["answer"] == said
    assert found["limits"]["thrust_room_fraction"] == pytest.approx(75.0 / 195.0)
    for name in ("prediction", "estimates"):
        assert "tells no" in found[name]["missing"]


def test_the_overview_has_axes_for_what_is_known_alone(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    titles: list[str] = []

    def note(figure: Figure, *_: Any, **__: Any) -> None:
        titles.extend(axes.get_title(loc="left").partition(",")[0] for axes in figure.axes)
        position = figure.axes[0].get_legend_handles_labels()[1]
        assert position == ["east", "north", "up", "setpoint"]

    monkeypatch.setattr(Figure, "savefig", note)
    found = read(run)
    assert found.params is not None
    flight_figure(found.plant, found.fcu, found.params, "Plain.", tmp_path / "x.png")
    assert set(titles) == SHOWN | {"Distance from the setpoint"}


def test_how_far_off_the_setpoint_it_was_is_drawn_without_a_reference(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One metre all the time, in the overview and in the figure of tracking."""
    from matplotlib.figure import Figure

    drawn: list[float] = []

    def note(figure: Figure, *_: Any, **__: Any) -> None:
        for axes in figure.axes:
            if axes.get_title(loc="left").startswith("Distance from the setpoint"):
                drawn.append(float(np.nanmax(np.asarray(axes.lines[0].get_ydata()))))

    monkeypatch.setattr(Figure, "savefig", note)
    done = CliRunner().invoke(
        main, ["plot", str(run), "--what", "flight,tracking", "--out", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    assert drawn == [1.0, 1.0]
    assert "no reference model; settled RMS 1 m off the setpoint" in done.stdout


def test_the_monitor_shows_what_the_vehicle_tells(readings: Readings) -> None:
    assert readings.follower.unusable == 0
    seen = readings.snapshot()
    assert (seen["time_s"], seen["thrust_N"]) == (N / RATE_HZ - 1.0 / RATE_HZ, 80.0)
    assert seen["roll_deg"] == pytest.approx(3.0)
    assert seen["position_m"] == [1.0, 0.0, 0.0]
    assert seen["reference_m"] == [None] * 3
    for name in ("mass_kg", "off_reference_m", "margin_N", "governed"):
        assert seen[name] is None
    for width, height in ((140, 42), (100, 60)):
        console = Console(width=width, record=True, file=io.StringIO())
        console.print(screen(readings, width, height), height=height)
        picture = console.export_text()
        assert "80.0 N" in picture and "thrust 5 to 200 N" in picture
        for absent in ("Estimates", "drag/mass", "predicted off", "Δu", "margin", "disturbance r"):
            assert absent not in picture
