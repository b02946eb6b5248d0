"""The figure of `gcs envelope`: where the room goes along the way, and how large a step may be."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fcu.kernel.algebra import Vec3
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import Envelope, step, terms, way
from gcs_tools.missions.mission import Mission
from gcs_tools.missions.timeline import foreseen, legs
from gcs_tools.pictures.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EVERY = 4  # of the look ahead's rows
SHARES = {
    "wind": ("drag of the wind", "#9ecae1"),
    "learning": ("estimates that lag", "#c7b9e0"),
    "tracking": ("closing the error that they leave", "#dadaeb"),
    "speed": ("drag of its own speed", "#a1d99b"),
    "acceleration": ("what the way demands", "#fdae6b"),
    "doubt": ("a jump, with a mass not known", "#fdd0a2"),
    "steering": ("tilts that steer, the wind from below", "#fbb4b9"),
}
POINTS = 9  # along f_m
DIRECTIONS = {
    "up": ((0.0, 0.0, 1.0), "-"),
    "to the side": ((1.0, 0.0, 0.0), "--"),
}


def save(mission: Mission, found: Envelope, path: Path) -> None:
    """Draw what was found of a mission. Raises OSError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_way(left, mission, found)
    _draw_steps(right, mission)
    says = "holds" if found.holds else "holds with the guard" if found.governed else "fails"
    figure.suptitle(f"{found.mission}: before flight, the condition {says}", fontsize=11)
    style.save(figure, path)


def _draw_way(axes: Axes, mission: Mission, found: Envelope) -> None:
    scene = scenario(mission)
    rows = way(scene)[::EVERY]
    spent = [
        terms(scene.settings, Vec3(*row[2:5].tolist()), Vec3(*row[5:8].tolist()), float(row[1]))
        for row in rows
    ]
    t, hover = rows[:, 0], spent[0].hover
    below = np.zeros(len(t))
    for name, (words, colour) in SHARES.items():
        share = np.array([getattr(s, name) for s in spent])
        axes.fill_between(t, below, below + np.maximum(share, 0.0), color=colour, label=words, lw=0)
        below = below + np.maximum(share, 0.0)
    used = hover - rows[:, 1]
    axes.plot(t, used, color="0.15", lw=1.2, label="in all")
    axes.axhline(hover, color="#b22222", lw=1.5)
    axes.annotate(
        f"room in hover, {hover:.0f} N", (t[-1], hover), (-4, 4), textcoords="offset points",
        ha="right", va="bottom", color="#b22222", fontsize=9,
    )  # fmt: skip
    short = "left" if found.holds else "short"
    axes.set_title(f"{abs(found.margin_n):.0f} N {short} at {found.at_s:.1f} s", fontsize=10)
    axes.set(xlabel="time, s", ylabel="N", xlim=(0.0, t[-1]))
    axes.set_ylim(0.0, 1.1 * max(float(used.max()), hover))
    axes.legend(fontsize=8, loc="upper right", framealpha=0.9)


def _draw_steps(axes: Axes, mission: Mission) -> None:
    settings = scenario(mission).settings
    law = settings.law
    f_m = np.geomspace(0.4, 3.0, POINTS)
    colours = {"exact": "#1f77b4", "ball": "#7f7f7f", "theorem": "#8c564b"}
    words = {"exact": "exact set", "ball": "ball about hover", "theorem": "(31)"}
    for way_name, (along, dashes) in DIRECTIONS.items():
        each = [settings._replace(law=law._replace(f_m=float(f))) for f in f_m]
        reached = [step(with_f_m, along, way_name) for with_f_m in each]
        for name, colour in colours.items():
            if name != "exact" and way_name != "up":
                continue  # these two know no direction
            label = f"{words[name]}, {way_name}" if name == "exact" else words[name]
            axes.loglog(f_m, [getattr(r, name) for r in reached], dashes, color=colour, label=label)
    jumps = [p for p in _jumps(mission) if p > 0.05]
    if jumps:
        axes.plot([law.f_m] * len(jumps), jumps, "o", color="#b22222", label="this mission's steps")
    axes.set_title("largest step from rest", fontsize=10)
    axes.set(xlabel="f_m, rad/s", ylabel="m")
    axes.set_xticks([0.5, 1.0, 2.0, 3.0], ["0.5", "1", "2", "3"])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _jumps(mission: Mission) -> list[float]:
    """Lengths (m) of the mission's steps; none for a curve, nor for the path of an item."""
    flight = mission.flight
    places = [flight.start.position_m, *(s.position_m for s in flight.setpoints)]
    found = [math.dist(a, b) for a, b in pairwise(places)]
    if flight.items:
        here, _ = foreseen(flight)
        for leg in legs(flight):
            if leg.kind == "go_to" and leg.place is not None:
                found.append(math.dist(here, leg.place))
            here = leg.place or here
    return found
