"""What is flown for the paper's figures: three flights, each under several laws."""

from __future__ import annotations

from dataclasses import dataclass

from fcu.laws.mmrac.types import Params
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.missions.mission import load
from gcs_tools.recording.table import Rows, Table
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord


@dataclass(frozen=True)
class Case:
    """One flight: a mission, and what is changed in it."""

    title: str
    mission: str
    settings: tuple[str, ...] = ()  # TABLE.KEY=VALUE


PRINTED, ACHIEVED, GUARDED = "as printed", "with Δu", "with the guard"
GOVERN = ("law.guard=govern",)
CASES = {
    "nominal": (
        Case(PRINTED, "paper_printed"), Case(ACHIEVED, "paper_nominal"),
        Case(GUARDED, "paper_nominal", GOVERN),
    ),
    "wrong_start": (
        Case(PRINTED, "paper_printed_wrong_start"), Case(ACHIEVED, "wrong_start"),
        Case(GUARDED, "wrong_start", GOVERN),
    ),
    "fast": (
        Case(PRINTED, "paper_printed_fast"), Case(ACHIEVED, "paper_fast"),
        Case(GUARDED, "paper_fast", GOVERN),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class FigureFlight:
    """A flight, by rows at the ticks at which the law was flying."""

    case: Case
    law: Params
    flight: EngagedTicks
    plant: Table  # the truth
    fcu: Table  # what the controller told
    ended: str  # "", or why before its time: "diverged" or "crashed"
    duration_s: float  # that the mission has

    @property
    def t(self) -> Rows:
        """Simulation time, s, (n,)."""
        return self.flight.t

    @property
    def command(self) -> str:
        """Flies it again."""
        settings = "".join(f" --set {setting}" for setting in self.case.settings)
        return f"gcs fly {self.case.mission}{settings}"


def fly(case: Case) -> FigureFlight:
    """Fly one. Raises MissionError."""
    mission = load(case.mission, case.settings)
    scene = scenario(mission)
    plant, fcu = law_alone.fly(scene)
    ended = dynamics.ENDED.get(Table.of(PlantRecord, plant)["ended"][-1], "")
    flight = EngagedTicks.of(Table.of(PlantRecord, plant), Table.of(Tick, fcu))
    return FigureFlight(
        case, scene.law, flight, flight.plant, flight.fcu, ended, mission.flight.duration_s
    )
