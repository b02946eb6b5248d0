"""A rotor is lost in flight: does the vehicle fly on, land, or is it lost, with and without being told?

    python -m gcs_tools.studies.rotor_loss                 every vehicle, scene and law (--seeds N a cell)
    python -m gcs_tools.studies.rotor_loss --page          writes their rows into the table of docs/rotor-loss.md

Each flight is a whole vehicle with its simulator, in process and in lockstep. The seed draws the moment, the
phases of the wind and noise on the state, and takes the rotors in turn. Without being told (CA_FAILURE_MODE 0)
allocation gives the rotor its share as before. Told, the vehicle finds the loss by the rotor's speed. By order
it hears of it from MAV_CMD_INJECT_FAILURE, which it passes on.

A flight flies on if it ends in the air within NEAR of its setpoint, upright, and not landing. It is away if it
ends like that farther from its setpoint. It lands if it ends on the ground without a crash. All else is lost.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from itertools import product
from typing import Any, NamedTuple

import click
import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.status_texts import Code
from fcu.kernel.rows import column_of, slice_of
from fcu.mavlink.definitions import CommandId
from fcu.mavlink.failures import Type, Unit
from gcs_tools.campaigns.statistics import interval
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import Mission, from_tables
from gcs_tools.recording.table import Rows
from gcs_tools.studies.failsafes import BEGIN, DOCS, END, written
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

PAGE = DOCS / "rotor-loss.md"
ROTORS = {"s1000": 8, "hexa": 6, "x8": 8}
SCENES = ("hover", "wind", "step")
WARNS = "mmrac-warn"  # M-MRAC whose guard governs nothing, as the paper flies
LAWS = ("mmrac", WARNS, "px4", "se3", "indi", "l1")
TELLS = ("untold", "found", "order")
ENDS = ("flies on", "away", "lands", "lost")
FAULTS: dict[str, dict[str, Any]] = {
    "off": {"kind": "motor_off"},
    "weak 0.75": {"kind": "motor_weak", "effectiveness": 0.75},
    "weak 0.5": {"kind": "motor_weak", "effectiveness": 0.5},
    "weak 0.25": {"kind": "motor_weak", "effectiveness": 0.25},
    "stuck": {"kind": "motor_stuck"},
}
RATE_HZ, ENDS_S = 250, 40.0
FROM_S, TO_S = 4.0, 7.0  # the rotor is lost between these
HIGH_M, STEP_M = 10.0, 8.0
NEAR = 2.0  # m
UPRIGHT = math.cos(math.radians(60.0))

_R = slice_of(PlantRecord, "state.r_E")
_XY = [column_of(PlantRecord, f"state.q_EB.{each}") for each in "xy"]
_ENDED, _ON_GROUND = column_of(PlantRecord, "ended"), column_of(PlantRecord, "on_ground")


class Cell(NamedTuple):
    """A line of the table."""

    airframe: str
    scene: str  # of SCENES
    law: str
    tells: str  # of TELLS
    fault: str = "off"  # of FAULTS


class Outcome(NamedTuple):
    """One flight."""

    rotor: int
    at_s: float
    end: str  # of ENDS
    away_m: float  # farthest from the setpoint after the loss, until it landed or the flight ended
    told_s: float  # from the loss until it was told; NaN: it was not


def mission(cell: Cell, seed: int, rotor: int, at_s: float) -> Mission:
    """The flight of a cell.  rotor : from 1, lost at a simulation time (s)."""
    random = np.random.default_rng([41, seed])
    setpoints = [{"at_s": 0.0, "position_m": [0.0, 0.0, HIGH_M]}]
    if cell.scene == "step":  # the rotor is lost within the two seconds of the step
        setpoints.append(
            {"at_s": round(at_s - random.uniform(0.0, 2.0), 3), "position_m": [STEP_M, 0.0, HIGH_M]}
        )
    tables: dict[str, Any] = {
        "title": "A rotor is lost.",
        "airframe": cell.airframe,
        "flight": {
            "duration_s": ENDS_S, "rate_hz": RATE_HZ, "seed": seed, "ground_z_m": 0.0,
            "start": {"position_m": [0.0, 0.0, HIGH_M]}, "setpoints": setpoints,
        },
        "law": {"module": "mmrac", "guard": "warn"} if cell.law == WARNS else {"module": cell.law},
        "plant": {"noise": {"position_m": 0.002, "rate_rad_s": 0.01}},
        "vehicle": {"params": {
            "CA_FAILURE_MODE": float(cell.tells != "untold"),
            "SYS_FAILURE_EN": float(cell.tells == "order"),
            "COM_DISARM_LAND": 1.0,
        }},
    }  # fmt: skip
    if cell.tells != "order":
        tables["plant"]["faults"] = [{"at_s": at_s, "rotor": rotor, **FAULTS[cell.fault]}]
    if cell.scene == "wind":
        phases = random.uniform(0.0, 2.0 * math.pi, 3).round(3).tolist()
        tables["wind"] = {"base": "paper", "phase_rad": phases}
    return from_tables("rotor_loss", tables)


class Losing(MemoryFlight):
    """A flight whose rotor is stopped by an order at a tick, or by its mission."""

    def __init__(self, scene: Scenario, rotor: int, at_tick: int) -> None:
        """`at_tick`: of an order. Negative: there is none."""
        super().__init__(scene, None, (_drop, _drop))
        self._rotor, self._at_tick = rotor, at_tick
        self.events: list[Event] = []

    def _log(self, stack: ExitStack, who: str) -> Callable[[Event], None]:
        return self.events.append

    def _send_setpoints(self, vehicle: Any) -> bool:
        self._orders = vehicle
        return super()._send_setpoints(vehicle)

    def _fly_to(self, tick: int) -> bool:
        if 0 <= self._at_tick <= tick:
            at, self._at_tick = self._at_tick, -1
            if not super()._fly_to(at):
                return False
            self._orders.command(CommandId.INJECT_FAILURE, Unit.MOTOR, Type.OFF, self._rotor)
        return super()._fly_to(tick)


def fly(cell: Cell, seed: int) -> Outcome:
    """Fly one seed of a cell."""
    rotor = 1 + seed % ROTORS[cell.airframe]
    at_tick = int(
        np.random.default_rng([43, seed]).integers(round(FROM_S * RATE_HZ), round(TO_S * RATE_HZ))
    )
    at_s = at_tick / RATE_HZ
    flight = Losing(
        scenario(mission(cell, seed, rotor, at_s)), rotor, at_tick if cell.tells == "order" else -1
    )
    plant = flight.fly().plant
    told = [each.t for each in flight.events if each.code == Code.ROTOR_LOST.name]
    landing = any(
        each.code == Code.FAILSAFE_MODE.name and each.values[0] == "Land" for each in flight.events
    )
    to_x = STEP_M if cell.scene == "step" else 0.0
    return Outcome(
        rotor, at_s, _end(plant, to_x, landing), _farthest(plant, at_tick, to_x),
        told[0] - at_s if told else math.nan,
    )  # fmt: skip


def _end(plant: Rows, to_x: float, landing: bool) -> str:
    last = plant[-1]
    x, y = (last[each] for each in _XY)
    upright = 1.0 - 2.0 * (x * x + y * y) > UPRIGHT
    if last[_ENDED] != dynamics.FLYING or not upright:
        return "lost"
    if last[_ON_GROUND] > 0.5:
        return "lands" if landing else "lost"
    if landing:
        return "lost"  # it has had more than enough time
    away = float(np.linalg.norm(last[_R] - np.array([to_x, 0.0, HIGH_M])))
    return "flies on" if away < NEAR else "away"


def _farthest(plant: Rows, at_tick: int, to_x: float) -> float:
    """Farthest across from the setpoint after the loss, m."""
    across = plant[at_tick:, _R][:, :2] - np.array([to_x, 0.0])
    return float(np.linalg.norm(across, axis=1).max()) if len(across) else math.nan


HEAD = (
    "| vehicle | scene | law | told | flies on | away | lands | lost | worst rotor | found after, s |",
    "|---|---|---|---|---|---|---|---|---|---|",
)
OF_FAULTS = (
    "| vehicle | scene | law | rotor | flies on | away | lost | found | after, s |",
    "|---|---|---|---|---|---|---|---|---|",
)


def line(cell: Cell, found: list[Outcome]) -> str:
    """A line of the table, with intervals of 95 %."""
    ends, n = Counter(each.end for each in found), len(found)

    def part(end: str) -> str:
        low, high = interval(ends[end], n)
        return f"{ends[end]} of {n} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"

    told = [each.told_s for each in found if not math.isnan(each.told_s)]
    after = f"{min(told):.3f} to {max(told):.3f}" if told else ""
    if cell.fault != "off":
        return (
            f"| {cell.airframe} | {cell.scene} | {cell.law} | {cell.fault} | {part('flies on')} |"
            f" {part('away')} | {part('lost')} | {len(told)} of {n} | {after} |"
        )
    parts = " | ".join(map(part, ENDS))
    return f"| {cell.airframe} | {cell.scene} | {cell.law} | {cell.tells} | {parts} | {worst(found)} | {after} |"


def worst(found: list[Outcome]) -> str:
    """Flights of the rotor that is worst to lose in which the vehicle flew on or landed, and that rotor."""
    ends = {rotor: [each.end for each in found if each.rotor == rotor] for rotor in range(1, 9)}
    good = {
        rotor: (sum(end in ("flies on", "lands") for end in its), len(its))
        for rotor, its in ends.items()
        if its
    }
    rotor = min(good, key=lambda each: good[each][0] / good[each][1])
    kept, n = good[rotor]
    return f"{kept} of {n}" if kept == n else f"{kept} of {n} ({rotor})"


def merged(page: str, lines: list[str]) -> list[str]:
    """Lines of the table of a page, with those that were flown in their place."""
    _, _, rest = page.partition(BEGIN.format("rotors"))
    table = rest.partition(END)[0].splitlines()[3:]
    rows = {_names(each): each for each in [*table, *lines] if each.startswith("| ")}
    cells = product(LAWS, ROTORS, SCENES, TELLS)
    keys = ((airframe, scene, law, told) for law, airframe, scene, told in cells)
    return [*HEAD, *(rows[key] for key in keys if key in rows)]


def _names(row: str) -> tuple[str, ...]:
    """The cell that a row of the table is of."""
    return tuple(row.removeprefix("| ").split(" | ", 4)[:4])


@click.command()
@click.option("--seeds", default=24, show_default=True, help="flights of each cell")
@click.option("--airframe", "airframes", multiple=True, type=click.Choice([*ROTORS]))
@click.option("--scene", "scenes", multiple=True, type=click.Choice(SCENES))
@click.option("--law", "laws", multiple=True, type=click.Choice(LAWS))
@click.option(
    "--told", "tells", multiple=True, type=click.Choice(TELLS), help="default: untold, found"
)
@click.option("--fault", default="off", show_default=True, type=click.Choice([*FAULTS]))
@click.option("--page", is_flag=True, help="write the rows into docs/rotor-loss.md")
def main(
    seeds: int, airframes: tuple[str, ...], scenes: tuple[str, ...], laws: tuple[str, ...],
    tells: tuple[str, ...], fault: str, page: bool,
) -> None:  # fmt: skip
    """Fly every cell, and print the table."""
    if fault != "off" and (page or "order" in tells):
        raise click.UsageError("--fault goes with neither --page nor --told order")
    lines: list[str] = []
    print(*(HEAD if fault == "off" else OF_FAULTS), sep="\n")
    for law in laws or LAWS:
        for airframe in airframes or ROTORS:
            for scene in scenes or SCENES:
                for told in tells or TELLS[:2]:
                    cell = Cell(airframe, scene, law, told, fault)
                    found = [fly(cell, seed) for seed in range(seeds)]
                    lines.append(line(cell, found))
                    print(lines[-1], flush=True)
    if page:
        text = PAGE.read_text()
        PAGE.write_text(written(text, "rotors", merged(text, lines)))


def _drop(_rows: object) -> None:
    """Keep no row."""


if __name__ == "__main__":
    main()
