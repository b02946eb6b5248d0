"""Landings in rough air: five airframes, every law, the masses that are believed, loads that drop, and noise.

    python -m gcs_tools.studies.landings                    draws 1000 landings
    python -m gcs_tools.studies.landings --flights N        as many (--first K: from that number, --json)
    python -m gcs_tools.studies.landings --report FILE      counts what --json has printed, and flies nothing

Each flight flies 15 m to the east and lands there, in process. In one flight of two it has taken off from
the ground. In the others it begins in the air and knows of no ground, which lies up to 2 m higher or lower
than under a flight that took off. Wind blows from anywhere, also from above and below, up to what is
believed of each airframe. In one flight of two the mass changes on the way, to another one that is
believed. The measured speed has noise of 0, 0.01 or 0.03 m/s. What is counted is the truth of the
simulator: rotors are cut in the air if the vehicle is disarmed, or led as one that rests on the ground,
with its feet more than 0.05 m above the ground.
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.progress import track

from fcu.interface.airframe import SHIPPED, find, read
from fcu.kernel.rows import column_of, slice_of
from fcu.laws import scales
from fcu.vehicle.setpoints import POSITION
from gcs_tools.campaigns.statistics import share
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables, with_airframe
from sitl_plant.physics.types import PlantRecord

AWAY_M, HEIGHT_M, RISES_M = 15.0, 6.0, 2.0
LAWS = "mmrac", "px4", "indi", "l1", "se3"
MASSES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)  # from the least to the greatest that is believed
STEADY, GUST = 0.75, 0.2  # of the greatest wind: 0.95 of it together
NOISE_M_S = (0.0, 0.01, 0.03)
LATE_S, CUT_M, TIPPED_DEG = 3.0, 0.05, 45.0
ON_GROUND, T = column_of(PlantRecord, "on_ground"), column_of(PlantRecord, "t")
R, V, Q = (slice_of(PlantRecord, f"state.{name}") for name in ("r_E", "v_E", "q_EB"))


class Landing(NamedTuple):
    """Outcome of one flight."""

    number: int
    airframe: str
    law: str
    took_off: bool  # from the ground on which it lands
    ended: str
    disarmed_s: float  # from the first contact of the landing; NaN: it was not disarmed
    touchdown_m_s: float  # at that contact, towards the ground
    cut_m: float  # the greatest height of the feet above the ground with the rotors cut
    tilt_deg: float  # at the end

    @property
    def faults(self) -> list[str]:
        """Names of what went wrong."""
        found = {
            "not landed": self.ended != "landed",
            "late": not self.disarmed_s <= LATE_S,
            "cut in the air": self.cut_m > CUT_M,
            "tipped": self.tilt_deg > TIPPED_DEG,
        }
        return [name for name, is_so in found.items() if is_so]


def sampled_landing(number: int) -> tuple[str, dict[str, Any]]:
    """The airframe and the tables of a flight, by its number alone."""
    random = np.random.default_rng((29, number))
    name = list(SHIPPED)[number % len(SHIPPED)]
    tables = read(find(name)).tables
    least, most = tables["vehicle"]["mass_kg"]
    masses = [least + x * (most - least) for x in MASSES]
    law = tables.get("law", {}).get("mmrac", {})
    wind_most = float(law.get("guard_wind_m_s", scales.wind(tables)))
    rate_most = float(law.get("guard_wind_rate_m_s2", scales.GUSTS * wind_most))
    way = random.normal(size=3)
    steady = STEADY * wind_most * random.uniform() ** 0.5 * way / np.linalg.norm(way)
    gust = GUST * wind_most * random.uniform(0.0, 1.0, 3) / math.sqrt(3.0)
    quickest = min(3.0, rate_most / max(float(np.linalg.norm(gust)), 1e-6))
    plant: dict[str, Any] = {
        "mass_kg": float(random.choice(masses)),
        "noise": {"velocity_m_s": float(random.choice(NOISE_M_S))},
    }
    if random.uniform() < 0.5:
        at_s = float(random.uniform(5.0, 25.0))
        plant["mass_change"] = {"at_s": at_s, "mass_kg": float(random.choice(masses))}
    start: dict[str, Any] = {"yaw_deg": float(random.uniform(-180.0, 180.0))}
    items: list[dict[str, Any]] = [
        {"kind": "go_to", "position_m": [AWAY_M, 0.0, HEIGHT_M], "within_m": 1.0},
        {"kind": "land"},
    ]
    ground_z_m = 0.0
    if number // len(SHIPPED) % 2:
        ground_z_m = float(random.uniform(-RISES_M, RISES_M))
        start["position_m"] = [0.0, 0.0, HEIGHT_M]
    else:
        start["on_ground"] = True
        items.insert(0, {"kind": "take_off", "height_m": HEIGHT_M})
    flight = {
        "duration_s": 90.0,
        "ground_z_m": ground_z_m,
        "seed": number,
        "start": start,
        "items": items,
    }
    wind = {
        "steady_m_s": steady.tolist(),
        "amplitude_m_s": gust.tolist(),
        "frequency_rad_s": random.uniform(0.5, max(quickest, 0.6), 3).tolist(),
        "phase_rad": random.uniform(0.0, 6.283, 3).tolist(),
    }
    title = "The vehicle lands in rough air."
    law_flown = LAWS[number // (2 * len(SHIPPED)) % len(LAWS)]
    tables = {"title": title, "law": {"module": law_flown}, "flight": flight}
    return name, tables | {"plant": plant, "wind": wind}


def fly(number: int) -> Landing:
    """Fly one landing."""
    name, tables = sampled_landing(number)
    scene = scenario(with_airframe(from_tables(f"landing {number}", tables), name))
    flight = MemoryFlight(scene, None, (_drop, _drop))
    flown = flight.fly()
    n = min(len(flown.plant), len(flown.fcu))
    plant, fcu, tick = flown.plant[:n], flown.fcu[:n], scene.kinds.tick
    params = scene.world.params.ground
    above = plant[:, R][:, 2] - params.z - params.gear
    engaged = fcu[:, column_of(tick, "engaged")] > 0.0
    led = fcu[:, column_of(tick, "setpoint.level")] <= POSITION
    begun = int(engaged.argmax()) if engaged.any() else n
    cut = (~engaged | ~led) & (np.arange(n) > begun)
    legs = {scene.legs[each.leg].kind: each.tick for each in flown.begun}
    lands_at = legs.get("land", n)
    touched = np.flatnonzero((plant[:, ON_GROUND] > 0.5) & (np.arange(n) >= lands_at))
    disarmed_s = down = math.nan
    if len(touched):
        first = int(touched[0])
        down = -float(plant[max(first - 1, 0), V][2])
        off = np.flatnonzero(~engaged[first:])
        if len(off):
            disarmed_s = float(plant[first + off[0], T] - plant[first, T])
    _, x, y, _ = flown.plant[-1, Q].tolist()
    tilt = math.degrees(math.acos(max(1.0 - 2.0 * (x * x + y * y), -1.0)))
    cut_m = float(above[cut].max(initial=0.0))
    law, took_off = tables["law"]["module"], "on_ground" in tables["flight"]["start"]
    return Landing(number, name, law, took_off, flown.ended, disarmed_s, down, cut_m, tilt)


def _drop(_rows: object) -> None:
    """Keep no row."""


@click.command()
@click.option("--flights", default=1000, show_default=True, help="of all airframes together")
@click.option("--first", default=0, show_default=True, help="number of the first")
@click.option("--json", "as_json", is_flag=True, help="one line a flight, for machines")
@click.option("--report", "files", multiple=True, type=click.Path(exists=True, dir_okay=False, path_type=Path), help="of --json; may be repeated")  # fmt: skip
def main(flights: int, first: int, as_json: bool, files: tuple[Path, ...]) -> None:
    """Fly landings of every shipped airframe, and print their faults. Exit code 1: there is one."""
    lines = [line for file in files for line in file.read_text().splitlines()]
    found = [Landing(**json.loads(line)) for line in lines]
    numbers = range(first, first + (0 if files else flights))
    for number in track(numbers, "landings", console=Console(stderr=True), disable=as_json):
        found.append(fly(number))
        if as_json:
            print(json.dumps(found[-1]._asdict()), flush=True)
    bad = sum(bool(each.faults) for each in found)
    if not as_json:
        report(found, bad)
    sys.exit(int(bad > 0))


def report(found: list[Landing], bad: int) -> None:
    """Print how many landings had a fault, of which kind, and the numbers of them all."""
    faults = Counter(fault for each in found for fault in each.faults)
    of = share(bad, len(found))
    part = f"{100.0 * of.low:.2f} to {100.0 * of.high:.2f} %"
    print(f"{len(found)} landings, {bad} with a fault ({part})")
    for fault in ("not landed", "late", "cut in the air", "tipped"):
        which = [each.number for each in found if fault in each.faults]
        print(f"  {fault}: {faults[fault]} {which[:10] or ''}")
    for name in ("disarmed_s", "touchdown_m_s", "cut_m"):
        values = [getattr(each, name) for each in found if math.isfinite(getattr(each, name))]
        print(
            f"  {name}: {np.median(values):.2f} in the middle, {np.quantile(values, 0.95):.2f} of 95 %,"
            f" {max(values):.2f} at most"
        )


if __name__ == "__main__":
    sys.exit(main())
