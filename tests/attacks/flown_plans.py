"""Plans with fences, drawn, flown in wind, and judged by the truth.

    python -m tests.attacks.flown_plans --plans 1000 -j 2

A plan has to be flown whole, each item reached and no border crossed, or to be refused at upload for a way that does
leave the fence. Nothing may saturate, as the guard governs. What is inside, and what is reached, is found here from
the recording without the vehicle's own code.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fcu.kernel.algebra import Vec3
from fcu.mavlink.geodesy import Origin, to_geodetic
from gcs_tools import fly, read

HOME = Origin(47.397742, 8.545594, 488.0)
AIRFRAMES = ("s1000", "hexa", "quad", "x8", "racer")
TAKE_OFF, WAYPOINT, TURNS, DELAY, SPEED, JUMP, LAND, RETURN = 22, 16, 18, 93, 178, 177, 21, 20
STEP_M = 0.05  # along a way that is looked at
SURE_M = 0.1  # a way so near a border may be refused or flown
REACHED_M = 0.5  # beyond the acceptance radius, as reference and vehicle differ
CROSSED_M = 0.5  # the vehicle beyond a border that its way keeps inside of


class Shape(NamedTuple):
    """A polygon of corners, or a circle about the first of them."""

    stays: bool
    corners: tuple[tuple[float, float], ...]
    radius: float = 0.0


class Item(NamedTuple):
    """An item of a plan, its place in m east, north and up of home."""

    command: int
    params: tuple[float | None, float | None, float | None, float | None] = (0.0, 0.0, 0.0, None)
    place: tuple[float, float, float] | None = None


class Drawn(NamedTuple):
    """A plan, its fence, and the mission file that flies it."""

    items: tuple[Item, ...]
    shapes: tuple[Shape, ...]
    mission: str
    airframe: str


# --- drawing


def _star(rng: random.Random, x: float, y: float, least: float, most: float, stays: bool) -> Shape:
    """A polygon about a place, seen whole from there."""
    n = rng.randint(3, 10)
    angles = sorted(rng.uniform(0.0, 2.0 * math.pi) for _ in range(n))
    if (
        max(b - a for a, b in zip(angles, [*angles[1:], angles[0] + 2.0 * math.pi], strict=True))
        > 2.9
    ):
        angles = [2.0 * math.pi * k / n for k in range(n)]
    far = [rng.uniform(least, most) for _ in angles]
    corners = tuple(
        (x + r * math.cos(q), y + r * math.sin(q)) for q, r in zip(angles, far, strict=True)
    )
    return Shape(stays, corners)


def drawn(seed: int) -> Drawn:
    """One plan of a seed: its fence holds home, its places are anywhere that the fence allows."""
    rng = random.Random(seed)
    size = rng.uniform(15.0, 60.0)
    shapes = [_star(rng, 0.0, 0.0, 0.5 * size, size, stays=True)]
    if rng.random() < 0.3:  # a second one to stay inside
        shapes.append(Shape(True, ((0.2 * size, 0.0),), 0.9 * size))
    for _ in range(rng.randint(0, 3)):
        away, q = rng.uniform(0.3, 0.9) * size, rng.uniform(0.0, 2.0 * math.pi)
        x, y, wide = away * math.cos(q), away * math.sin(q), rng.uniform(0.03, 0.15) * size
        shape = (
            Shape(False, ((x, y),), wide)
            if rng.random() < 0.5
            else _star(rng, x, y, 0.4 * wide, wide, stays=False)
        )
        shapes.append(shape)
    keeps = rng.choice([0.0, 3.0, 3.0, 3.0])  # that most plans keep from borders, with their ways
    at = (0.0, 0.0, rng.uniform(4.0, 12.0))
    items = [Item(TAKE_OFF, place=at)]
    for _ in range(rng.randint(3, 8)):
        for _ in range(60):
            place = (rng.uniform(-size, size), rng.uniform(-size, size), rng.uniform(4.0, 25.0))
            if way_margin(shapes, at, place) > keeps:
                items.append(_led(rng, place))
                at = place
                break
        if rng.random() < 0.25:
            items.append(Item(SPEED, (1.0, rng.uniform(2.0, 12.0), -1.0, 0.0)))
        if rng.random() < 0.1:
            items.append(Item(DELAY, (rng.uniform(0.0, 4.0), 0.0, 0.0, 0.0)))
    if rng.random() < 0.2 and len(items) > 4:
        to = rng.randint(1, len(items) - 2)
        items.append(Item(JUMP, (float(to), 1.0, 0.0, 0.0)))
    items.append(Item(LAND, place=(at[0], at[1], 0.0)) if rng.random() < 0.5 else Item(RETURN))
    return Drawn(tuple(items), tuple(shapes), _mission(rng), rng.choice(AIRFRAMES))


def _led(rng: random.Random, place: tuple[float, float, float]) -> Item:
    if rng.random() < 0.1:
        return Item(TURNS, (1.0, 0.0, rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 8.0), None), place)
    hold = rng.choice([0.0, 0.0, 0.0, 2.0])
    yaw = rng.uniform(-180.0, 180.0) if rng.random() < 0.2 else None
    return Item(WAYPOINT, (hold, rng.uniform(0.5, 5.0), 0.0, yaw), place)


def _mission(rng: random.Random) -> str:
    steady = [rng.uniform(-5.0, 5.0), rng.uniform(-5.0, 5.0), rng.uniform(-1.0, 1.0)]
    sway = [rng.uniform(0.0, 2.0), rng.uniform(0.0, 2.0), rng.uniform(0.0, 0.7)]
    turn = [rng.uniform(0.3, 1.5) for _ in range(3)]
    return f"""title = "A drawn plan is flown in wind."

[flight]
duration_s = 900.0
ground_z_m = 0.0
arena_m = 1000.0
start = {{ on_ground = true }}
plan = "drawn.plan"

[law]
guard = "govern"

[wind]
steady_m_s = {steady}
amplitude_m_s = {sway}
frequency_rad_s = {turn}

[expect]
ended = "landed"
"""


def plan_file(made: Drawn) -> str:
    """The plan as QGroundControl writes it."""
    items = []
    for number, item in enumerate(made.items, start=1):
        where = (
            [0.0, 0.0, 0.0] if item.place is None else [*_lat_lon(item.place[:2]), item.place[2]]
        )
        params = list(item.params)
        if item.command == JUMP:  # its file names an item by its doJumpId
            params[0] = (params[0] or 0.0) + 1.0
        frame = 2 if item.place is None else 3
        items.append({"autoContinue": True, "command": item.command, "doJumpId": number,
                      "frame": frame, "params": [*params, *where], "type": "SimpleItem"})  # fmt: skip
    polygons, circles = [], []
    for shape in made.shapes:
        places = [_lat_lon(corner) for corner in shape.corners]
        if shape.radius:
            circles.append({"circle": {"center": places[0], "radius": shape.radius},
                            "inclusion": shape.stays, "version": 1})  # fmt: skip
        else:
            polygons.append({"inclusion": shape.stays, "polygon": places, "version": 1})
    return json.dumps({
        "fileType": "Plan", "version": 1, "groundStation": "drawn",
        "mission": {
            "cruiseSpeed": 15, "hoverSpeed": 5, "firmwareType": 12, "vehicleType": 2, "version": 2,
            "globalPlanAltitudeMode": 1, "items": items,
            "plannedHomePosition": [HOME.lat_deg, HOME.lon_deg, HOME.alt_m],
        },
        "geoFence": {"circles": circles, "polygons": polygons, "version": 2},
        "rallyPoints": {"points": [], "version": 2},
    })  # fmt: skip


def _lat_lon(across: tuple[float, ...]) -> list[float]:
    lat, lon, _ = to_geodetic(HOME, Vec3(across[0], across[1], 0.0))
    return [lat, lon]


# --- the oracle


def margins(shapes: tuple[Shape, ...] | list[Shape], r: np.ndarray) -> np.ndarray:
    """How far places (n, 2) are inside, below 0 outside."""
    least = np.full(len(r), np.inf)
    for shape in shapes:
        corners = np.array(shape.corners)
        if shape.radius:
            depth = shape.radius - np.hypot(*(r - corners[0]).T)
        else:
            ends, within = np.roll(corners, -1, axis=0), np.zeros(len(r), dtype=bool)
            nearest = np.full(len(r), np.inf)
            for a, b in zip(corners, ends, strict=True):
                along = b - a
                part = np.clip((r - a) @ along / (along @ along), 0.0, 1.0)
                nearest = np.minimum(nearest, np.hypot(*(r - a - part[:, None] * along).T))
                over = (a[1] > r[:, 1]) != (b[1] > r[:, 1])
                with np.errstate(divide="ignore", invalid="ignore"):
                    within ^= over & (r[:, 0] < a[0] + (r[:, 1] - a[1]) * along[0] / along[1])
            depth = np.where(within, nearest, -nearest)
        least = np.minimum(least, depth if shape.stays else -depth)
    return least


def way_margin(
    shapes: tuple[Shape, ...] | list[Shape], a: tuple[float, ...], b: tuple[float, ...]
) -> float:
    """The least margin along a straight way."""
    n = 2 + int(math.dist(a[:2], b[:2]) / STEP_M)
    parts = np.linspace(0.0, 1.0, n)[:, None]
    return float(margins(shapes, np.array(a[:2]) * (1.0 - parts) + np.array(b[:2]) * parts).min())


def in_order(items: tuple[Item, ...]) -> Iterator[int]:
    """The items as they are done, jumps followed."""
    n, jumped = 0, Counter()
    while n < len(items):
        yield n
        item = items[n]
        if item.command == JUMP and jumped[n] < (item.params[1] or 0.0):
            jumped[n] += 1
            n = int(item.params[0] or 0.0)
        else:
            n += 1


def least_margin(made: Drawn) -> float:
    """The least margin of all that the plan asks for."""
    least, at = math.inf, (0.0, 0.0)
    for n in in_order(made.items):
        item = made.items[n]
        if item.place is None:
            continue
        least = min(least, way_margin(made.shapes, at, item.place))
        if item.command == TURNS:
            q = np.linspace(0.0, 2.0 * math.pi, 400)
            ring = abs(item.params[2] or 0.0) * np.column_stack([np.cos(q), np.sin(q)])
            least = min(least, float(margins(made.shapes, np.array(item.place[:2]) + ring).min()))
        at = item.place[:2]
    return least


def not_reached(made: Drawn, r: np.ndarray) -> int | None:
    """The first item, as they are done, to which the vehicle did not come. r: (n, 3), m. None: none."""
    begin = 0
    for n in in_order(made.items):
        item = made.items[n]
        if item.place is None:
            continue
        away = np.hypot(*(r[begin:, :2] - item.place[:2]).T)
        if item.command == TURNS:
            near = np.abs(away - abs(item.params[2] or 0.0)) < 2.0 * REACHED_M
        elif item.command == LAND:
            near = (away < 1.0) & (r[begin:, 2] < 1.0)
        else:
            near = (
                np.hypot(away, r[begin:, 2] - item.place[2]) < (item.params[1] or 2.0) + REACHED_M
            )
        found = np.flatnonzero(near)
        if not len(found):
            return n
        begin += int(found[0])
    return None


# --- flying


class Outcome(NamedTuple):
    """One drawn plan: what became of it, what is wrong with that, and figures."""

    seed: int
    outcome: str
    wrong: str
    asked_m: float  # least margin of the plan's ways
    kept_m: float  # least margin of the vehicle


def flown(seed: int) -> Outcome:
    """Draw and fly one plan."""
    made = drawn(seed)
    asked = least_margin(made)
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "drawn.plan").write_text(plan_file(made))
        (here / "drawn.toml").write_text(made.mission)
        with contextlib.redirect_stderr(io.StringIO()):
            result = fly(str(here / "drawn.toml"), airframe=made.airframe, in_process=True,
                         out=here / "run", figure="never", record="light")  # fmt: skip
        if result.ended == "refused":
            wrong = "" if asked < SURE_M else "refused without need"
            return Outcome(
                seed,
                "refused",
                wrong and f"{wrong}: {result.error} {result.causes}",
                asked,
                math.nan,
            )
        recording = read(here / "run" / "flight.mcap")
        r = recording.plant["state.r_E"]
    air = r[:, 2] > 0.3
    kept = float(margins(made.shapes, r[air][:, :2]).min()) if air.any() else math.inf
    wrong = []
    if asked < -SURE_M:
        wrong.append(f"accepted with a way {-asked:.2f} m outside")
    if kept < -CROSSED_M:
        wrong.append(f"crossed a border by {-kept:.2f} m")
    breached = kept < 0.0 and asked < 1.0
    if not breached:
        if result.ended != "landed":
            wrong.append(f"ended {result.ended}: {result.error or ' '.join(result.causes)}")
        elif (n := not_reached(made, r)) is not None:
            wrong.append(f"item {n} not reached")
    for name in ("thrust", "tilt", "torque"):
        if result.metrics.get(f"{name}_saturated_fraction"):
            wrong.append(f"{name} saturated {result.metrics[f'{name}_saturated_fraction']:.2g}")
    outcome = "beside a border" if breached else result.ended
    return Outcome(seed, outcome, "; ".join(wrong), asked, kept)


def main() -> None:
    """Fly so many, name each finding, and exit with 1 if there is one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plans", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("-j", "--jobs", type=int, default=2)
    args = parser.parse_args()
    outcomes, found, least = Counter[str](), 0, math.inf
    with ProcessPoolExecutor(args.jobs) as pool:
        for each in pool.map(flown, range(args.seed, args.seed + args.plans)):
            outcomes[each.outcome] += 1
            if each.asked_m >= 1.0 and not math.isnan(each.kept_m):
                least = min(least, each.kept_m)
            if each.wrong:
                found += 1
                print(
                    f"seed {each.seed}: {each.wrong} (asked {each.asked_m:.2f} m, kept {each.kept_m:.2f} m)",
                    flush=True,
                )
    print(f"{dict(outcomes)}; least margin of ways that keep 1 m: {least:.2f} m; findings: {found}")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
