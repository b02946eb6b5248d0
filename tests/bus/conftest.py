"""Flights that are put on the bus, and who listens, stalls, dies or shouts there."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest

from fcu.interface import topics
from fcu.interface.ports import ports
from gcs_tools.judging import result
from gcs_tools.live.recorder import GONE
from gcs_tools.recording import reader as recording
from gcs_tools.recording.schema import TOPICS
from tests.patience import until
from tests.process.conftest import Program, _until, claimed_instance, instance, start

__all__ = ["_until", "instance", "start"]

MEGABYTE = 1 << 20
LOCKSTEP = ("--speed", "max")
PACED = ("--speed", "5")  # six seconds of wall time
BOTH = pytest.mark.parametrize("speed", [LOCKSTEP, PACED], ids=["lockstep", "paced"])
SAID = (topics.EVENTS, topics.ABOUT, topics.ENDED)
TICKS = 15_000
MISSION = (
    "paper_nominal",
    "--set",
    "flight.duration_s=30",
    "--figure",
    "never",
)  # its yaw command is streamed


class Flight:
    """`gcs fly` of MISSION."""

    def __init__(self, program: Program, instance: int, run: Path) -> None:
        self.program = program
        self.instance = instance
        self.run = run
        self.recording = run / "flight.mcap"

    def under_way(self, size: int = MEGABYTE) -> None:
        """Wait until so many bytes of it are on file (of 25 MiB)."""
        until(lambda: self.recording.exists() and self.recording.stat().st_size > size, "a flight")

    def is_over(self) -> bool:
        return self.program.process.poll() is not None

    @property
    def said(self) -> str:
        """On its terminal, in one line."""
        return " ".join(self.program.text().split())

    @property
    def publisher(self) -> int:
        """The pid of its publisher."""
        return until(lambda: self.program.children().get("gcs_tools"), "a publisher")

    @property
    def publisher_said(self) -> str:
        return (self.run / "publisher.log").read_text()

    @property
    def publisher_complained(self) -> list[str]:
        """Lines of its log but those of ticks that came too fast, as on a busy machine they do."""
        lines = self.publisher_said.splitlines()
        return [line for line in lines if "came too fast to be published" not in line]

    def unpublished(self, who: str) -> int:
        """Ticks that it says, at its end, did not reach its publisher."""
        found = re.search(rf"(\d+) ticks of the {who}\b.* came too fast to be published", self.said)
        assert found, self.said
        return int(found[1])

    @property
    def keys(self) -> list[str]:
        """All that it publishes, and all there can be."""
        within = topics.namespace(self.run.name), str(ports(self.instance).system_id)
        found = [*(name[1:] for name in TOPICS), *SAID, "alive/fcu", "alive/publisher"]
        return ["m_mrac/**", "**", *("/".join((*within, name)) for name in found)]

    def trajectory(self) -> str:
        """Its hash, when it has flown to the end."""
        code = self.program.wait()
        assert code == 0, self.program.text()
        left = result.read(self.run / "result.json")
        assert (left.ended, left.error) == ("time", None)
        return left.trajectory_sha256


@pytest.fixture
def fly(start, tmp_path):
    """`fly(instance, *options)`: a flight that is published."""
    flights = []

    def begin(instance: int, *options: object, **how: object) -> Flight:
        run = tmp_path / f"run{len(flights)}"
        program = start(
            "gcs_tools", "fly", *MISSION, "--publish", "--instance", instance, "--out", run,
            *options, **how,
        )  # fmt: skip
        flights.append(Flight(program, instance, run))
        return flights[-1]

    return begin


@pytest.fixture(scope="session")
def unheard(tmp_path_factory):
    """MISSION, flown when nobody listens, nor could."""
    folder = tmp_path_factory.mktemp("quiet")
    with claimed_instance() as number:
        program = Program(
            folder, "gcs_tools", "fly", *MISSION, "--no-publish", "--instance", str(number),
            "--out", str(folder / "run"),
        )  # fmt: skip
        try:
            program.wait()
            return Flight(program, number, folder / "run")
        finally:
            program.kill()


@pytest.fixture
def quiet(unheard):
    """The hash of that flight."""
    return unheard.trajectory()


class Recorder:
    """`gcs record --json`."""

    def __init__(self, program: Program, out: Path) -> None:
        self.program = program
        self.out = out

    def waits(self) -> None:
        """Until it looks for a vehicle."""
        self.program.says("waiting for instance")

    def under_way(self, size: int = MEGABYTE // 4) -> None:
        """Wait until so many bytes are on file."""
        until(lambda: self.out.exists() and self.out.stat().st_size > size, "a recording")

    def ended(self, code: int = 0) -> dict:
        """What it says when it has ended by itself."""
        assert self.program.wait() == code, self.program.text()
        return json.loads(self.program.out.read_text())

    def interrupted(self) -> dict:
        """What it says after a Ctrl-C."""
        assert self.program.interrupted() == 0, self.program.text()
        return json.loads(self.program.out.read_text())

    def killed(self) -> None:
        self.program.signal(signal.SIGKILL)
        self.program.process.wait()

    def adds_up(self) -> recording.Recording:
        """What it recorded of a whole flight, when what it has and what it says it lost is all."""
        said = self.ended()
        assert (said["ended"], said["end_seen"]) == (GONE, True)
        assert said["not_the_vehicles"] == 0
        found = recording.read(self.out)
        assert found.complete
        for topic, rows in found.reports.items():
            missing_at_first = int(rows["timing.sequence"][0]) if "timing" in topic else None
            lost = said["lost"].get(topic, 0)
            assert said["topics"][topic] == len(rows)
            assert found.lost.get(topic, 0) <= lost
            if missing_at_first is not None:
                assert missing_at_first + len(rows) + lost == TICKS
        return found


@pytest.fixture
def record(start, tmp_path):
    """`record(instance, *options)`: a recorder of its own."""
    recorders = []

    def begin(instance: int | None, *options: object, **how: object) -> Recorder:
        out = tmp_path / f"recorded{len(recorders)}.mcap"
        which = () if instance is None else ("--instance", instance)
        program = start("gcs_tools", "record", out, "--json", *which, *options, **how)
        recorders.append(Recorder(program, out))
        return recorders[-1]

    return begin


@pytest.fixture
def recorded(fly, record, instance):
    """`recorded(*options)`: a flight under way and somebody who records it."""

    def begin(*options):
        recorder = record(instance)
        recorder.waits()
        flight = fly(instance, *options)
        recorder.under_way()
        flight.under_way()
        assert not flight.is_over()
        return flight, recorder

    return begin
