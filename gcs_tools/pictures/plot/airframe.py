"""The figure of `gcs airframe`: the rotors from above, and what they can do beside hovering."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.judging.airframe_check import AirframeCheck, Rotor
from gcs_tools.pictures.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SPINS = {1: ("counter-clockwise", style.X), -1: ("clockwise", style.Y)}
WIDE, NARROW = 0.42, 0.27  # of the least distance between rotors: drawn radius, and of one below
ALONE = 0.6  # of the arm, in place of that distance, where all are in one place
ARC = 290.0  # deg, of the turn that is drawn
TOGETHER = 1e-6  # m: two rotors above each other


def save(found: AirframeCheck, path: Path) -> None:
    """Draw an airframe. Raises OSError."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(style.STYLE):
        figure = Figure(figsize=(9.6, 5.4), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _draw_rotors(left, found)
        _draw_load(right, found)
        throttle = f"hover throttle {100.0 * found.hover_throttle:.0f} %"
        thrust = f"greatest thrust {found.thrust_to_weight:.2f} times the weight"
        name = Path(found.airframe).name.removesuffix(".toml")
        figure.suptitle(f"{name}: {throttle}, {thrust}", fontsize=11)
        style.save(figure, path)


def _radius(rotors: tuple[Rotor, ...]) -> float:
    """Half of what is there for a rotor's disc: the least distance of two that are not above each other."""
    places = np.array([(r.forward_m, r.left_m) for r in rotors])
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    beside = apart[apart > TOGETHER]
    arm = float(np.linalg.norm(places, axis=1).max())
    return float(beside.min()) if len(beside) else ALONE * arm


def _draw_rotors(axes: Axes, found: AirframeCheck) -> None:
    rotors = found.rotors
    apart = _radius(rotors)
    for rotor in rotors:
        same = [
            r
            for r in rotors
            if math.hypot(rotor.forward_m - r.forward_m, rotor.left_m - r.left_m) < TOGETHER
        ]
        below = any(r.up_m > rotor.up_m for r in same)
        _draw_rotor(axes, rotor, apart * (NARROW if below else WIDE), below, len(same) == 1)
    reach = max(max(abs(r.forward_m), abs(r.left_m)) for r in rotors) + 0.62 * apart
    axes.plot(0.0, 0.0, marker="+", color=style.INK, markersize=9.0)
    axes.annotate(
        "nose", xy=(0.0, 1.25 * reach), xytext=(0.0, 1.05 * reach), ha="center", va="center",
        color=style.GREY, arrowprops={"arrowstyle": "-|>", "color": style.GREY},
    )  # fmt: skip
    axes.set(
        xlim=(1.05 * reach, -1.05 * reach), ylim=(-1.05 * reach, 1.3 * reach), aspect="equal",
        xlabel="left, m", ylabel="forward, m", title="Rotors from above",
    )  # fmt: skip
    for words, colour in SPINS.values():
        axes.plot([], [], color=colour, linewidth=2.0, label=words)
    inside = " (inside: below)" if any(r.up_m < 0.0 for r in rotors) else ""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, title=f"spin{inside}")


def _draw_rotor(axes: Axes, rotor: Rotor, radius: float, below: bool, alone: bool) -> None:
    _, colour = SPINS[rotor.spin]
    x, y = rotor.left_m, rotor.forward_m
    axes.plot([0.0, x], [0.0, y], color="#dddddd", linewidth=3.0, zorder=0.5)
    # seen from above with x drawn to the left, counter-clockwise is as on paper
    turn = np.radians(np.linspace(0.0, ARC, 60))
    first = math.radians(125.0)
    at = first + rotor.spin * turn
    across, ahead = -radius * np.cos(at), radius * np.sin(at)
    dashes = (0, (4, 2)) if below else "-"
    axes.plot(x + across, y + ahead, color=colour, linewidth=2.0, linestyle=dashes)
    axes.annotate(
        "", xy=(x + across[-1], y + ahead[-1]), xytext=(x + across[-4], y + ahead[-4]),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 2.0, "mutation_scale": 13.0},
    )  # fmt: skip
    out = 0.0 if below or alone else 1.25 * radius / max(math.hypot(x, y), TOGETHER)
    axes.text(
        (1.0 + out) * x, (1.0 + out) * y, f"{rotor.number}", ha="center", va="center",
        weight="bold", color=colour,
    )  # fmt: skip


def _draw_load(axes: Axes, found: AirframeCheck) -> None:
    """Thrust of each rotor in hover, of what it can give; and what the axes have beside it."""
    rotors = found.rotors
    at = np.arange(len(rotors))
    axes.barh(at, [r.thrust_max_n for r in rotors], color="#e8e8e8", label="at full speed")
    axes.barh(
        at, [r.hover_thrust_n for r in rotors], color=[SPINS[r.spin][1] for r in rotors], height=0.5,
        label="in hover",
    )  # fmt: skip
    axes.set_yticks(at, [str(r.number) for r in rotors])
    axes.invert_yaxis()
    axes.set(xlabel="thrust, N", ylabel="rotor", title="Thrust in hover, of full")
    lines = [
        f"{each.axis}: {each.acceleration_rad_s2:.3g} rad/s\u00b2, {each.torque_n_m:.3g} N m"
        for each in found.authority
    ]
    axes.text(
        0.0, -0.2, "Beside hover\n" + "\n".join(lines), transform=axes.transAxes, va="top", color=style.INK,
    )  # fmt: skip
