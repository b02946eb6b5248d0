"""Each estimate with its truth and the bounds of its projection."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, finite, percent, rms, said
from gcs_tools.pictures.plot.style import DASHED, INK, MUTED, THREE, TIME, WIDE, legend, line, zoom
from gcs_tools.pictures.plot.window import Window
from gcs_tools.pictures.quantities import BY_TITLE, of_rotor, parts, rotors_of
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 10.4)  # inches
QUESTION = "Are the estimates right?"
FIVE = (*THREE, "#cc79a7", "#8c6d00")
DRAG_TORQUE = "plant.drag_torque"  # of the metadata


class Estimate(NamedTuple):
    """One line: an estimate and what it should be."""

    name: str
    hat: Rows
    truth: Rows | None  # None: not recorded


def estimated(window: Window, title: str) -> list[Estimate]:
    """Those of a quantity that is held against a truth."""
    q, known = BY_TITLE[title], window.history.flown
    columns = zip(q.labels, q.columns, q.truth, strict=True)
    return [Estimate(label, known(hat)[1], known(truth)[1]) for label, hat, truth in columns]


def angular(window: Window) -> list[Estimate]:
    """s_w_hat, rad/s^2, B, and its truth.

    The truth is what turns the body beside what the controller believes that its rotors do: the
    air's torque -c a |a|, with a the body's rate against the air and c the true coefficient in
    the metadata, and the rotors' true torque less the believed one of the same speeds; over
    inertia. Without c, and while the ground pushes too, there is none.
    """
    c_tau = window.truth(DRAG_TORQUE)
    hats = window.fcu.axes("state.estimates.s_w_hat")
    if c_tau is None or len(c_tau) != 3:
        return [Estimate(name, hat, None) for name, hat in zip("pqr", hats, strict=True)]
    a = window.plant["state.w_B"] - window.plant["w_air_B"]
    tau = window.plant["tau_B"] - _believed_torque(window) - c_tau * a * np.abs(a)
    truth = tau / window.plant["J"]
    truth[window.plant["on_ground"] > 0.5] = np.nan
    return [Estimate(name, hats[i], truth[:, i]) for i, name in enumerate("pqr")]


def _believed_torque(window: Window) -> Rows:
    """Torque (N m, B), (n, 3), of the true rotor speeds with the coefficients the law was told."""
    x, y, spin, c_T = (np.array(of_rotor(window.told, of)) for of in ("x", "y", "spin", "c_T"))
    there = rotors_of(window.told)
    Omega = np.stack([window.plant[name] for name in parts("state.Omega", there)], axis=1)
    effect = np.stack([y, -x, -window.told["law.rotors.k_Q"] * spin])
    torque: Rows = (c_T * Omega * Omega) @ effect.T
    return torque


def couplings(window: Window) -> list[Estimate]:
    """The five coefficients of (43). Those of products of rates follow from the true inertia.

    Those of the rotors' gyroscopic torque hang on a rotor's inertia, which is not recorded.
    """
    x, y, z = window.plant.axes("J")
    return [
        Estimate("p1", window.fcu["state.estimates.c_p1_hat"], (y - z) / x),
        Estimate("q1", window.fcu["state.estimates.c_q1_hat"], (z - x) / y),
        Estimate("r1", window.fcu["state.estimates.c_r1_hat"], (x - y) / z),
        Estimate("p2", window.fcu["state.estimates.c_p2_hat"], None),
        Estimate("q2", window.fcu["state.estimates.c_q2_hat"], None),
    ]


def _norm_rms(window: Window, of: list[Estimate]) -> float | None:
    """RMS of the distance of three estimates from their truth, once settled."""
    pairs = [(e.hat - e.truth)[window.settled] for e in of if e.truth is not None]
    if len(pairs) < 3:
        return None
    square = np.sum(np.square(pairs), axis=0)
    return rms(np.sqrt(square[~np.isnan(square)]))


def numbers(window: Window) -> Numbers:
    """Errors at the end, or RMS once settled; how often projection holds one. Raises Missing."""
    window.t, window.told  # noqa: B018  what the figure needs
    window.need("Mass", "Inertia", "Drag over mass")
    m, m_hat = window.plant["m"], window.fcu["state.estimates.m_hat"]
    J = zip(window.fcu.axes("state.estimates.J_hat"), window.plant.axes("J"), strict=True)
    off = [float((hat[-1] - true[-1]) / true[-1]) for hat, true in J]
    drag = estimated(window, "Drag over mass")
    return {
        "mass_error_final_kg": finite(m_hat[-1] - m[-1]),
        "mass_error_final_fraction": finite((m_hat[-1] - m[-1]) / m[-1]),
        "inertia_error_final_fraction": finite(max(off, key=abs)),
        "drag_rms_settled_m_s2": _norm_rms(window, drag),
        "drag_across_rms_settled_m_s2": rms(
            np.hypot(*((e.hat - e.truth)[window.settled] for e in drag[:2] if e.truth is not None))
        ),
        "angular_rms_settled_rad_s2": _norm_rms(window, angular(window)),
        "projected_fraction": finite(float(np.mean(window.fcu["internals.flags.projected"] > 0.5))),
    }


def answer(found: Numbers) -> str:
    """In one line."""

    def signed(key: str) -> str:
        value = found[key]
        return "no value" if value is None else f"{100.0 * value:+.1f} %"

    across = found["drag_across_rms_settled_m_s2"]
    drag = said(across, "m/s²")
    return (
        f"at the end mass {signed('mass_error_final_fraction')}, inertia "
        f"{signed('inertia_error_final_fraction')} (worst axis); horizontal drag RMS {drag}; "
        f"held by projection {percent(found['projected_fraction'])} of the time"
    )


def notes(window: Window) -> list[str]:
    """What to know when reading it."""
    if window.truth(DRAG_TORQUE) is None:
        angular_truth = "No truth for ŝ_ω: this recording does not name the true drag torque."
    else:
        angular_truth = (
            "Truth of ŝ_ω: torque of the air, and of rotors that give other than is believed."
        )
    printed = "Prediction as printed: ŝ_v has to find gravity too, so its truth holds it."
    return [
        "Mass and vertical drag are told apart only by manoeuvres: in hover their errors cancel.",
        *([printed] if window.told["law.achieved"] < 0.5 else []),
        angular_truth,
        "ĉ: p1, q1 and r1 are of couplings; p2 and q2 (thin) are gyroscopic and have no truth, as "
        "the true inertia of a rotor is not recorded.",
    ]


def draw(figure: Figure, window: Window, _found: Numbers) -> None:
    """Five groups of estimates, and how much of its set each uses."""
    (drag, mass), (disturbance, moments), (coefficients, used) = figure.subplots(3, 2, sharex=True)
    told = window.told
    bound = {name: told[f"law.bounds.{name}"] for name in ("s_v_max", "s_w_max", "c_max")}
    m, J = ((told[f"law.bounds.{name}_min"], told[f"law.bounds.{name}_max"]) for name in "mJ")

    s_v = estimated(window, "Drag over mass")
    _group(drag, window, "Drag force over mass ŝ_v, m/s²", s_v, symmetric(bound["s_v_max"]), 1.0)
    m_hat = estimated(window, "Mass")
    _group(mass, window, "Mass m̂, kg", m_hat, m)
    s_w = angular(window)
    title = "Angular disturbance ŝ_ω, rad/s²"
    _group(disturbance, window, title, s_w, symmetric(bound["s_w_max"]), 0.1)
    J_hat = estimated(window, "Inertia")
    _group(moments, window, "Inertia Ĵ, kg m²", J_hat, J)
    c = couplings(window)
    title = "Coefficients ĉ"
    _group(coefficients, window, title, c, symmetric(bound["c_max"]), 0.5)

    used.set_title("Share of its set used")
    sets = (
        ("ŝ_v", s_v, symmetric(bound["s_v_max"])), ("m̂", m_hat, m),
        ("ŝ_ω", s_w, symmetric(bound["s_w_max"])), ("Ĵ", J_hat, J),
        ("ĉ", c, symmetric(bound["c_max"])),
    )  # fmt: skip
    for (name, of, (low, high)), colour in zip(sets, (*FIVE[:3], INK, FIVE[3]), strict=True):
        off = np.abs(np.stack([e.hat for e in of]) - 0.5 * (low + high)).max(axis=0)
        line(used, window.t, off / (0.5 * (high - low)), color=colour, label=name)
    used.axhline(1.0, label="held", zorder=1, **DASHED)
    used.set_ylim(0.0, 1.08)
    legend(used)
    for axes in (coefficients, used):
        axes.set_xlabel(TIME)


def symmetric(bound: float) -> tuple[float, float]:
    """The set of what is bounded in size."""
    return -bound, bound


def _group(
    axes: Axes, window: Window, title: str, of: list[Estimate], within: tuple[float, float],
    least: float | None = None,
) -> None:  # fmt: skip
    """Estimates over truths. With `least`, zoomed to what is settled; without, to the bounds."""
    axes.set_title(title)
    t = window.t
    for e, colour in zip(of, FIVE, strict=False):
        if e.truth is not None:
            line(axes, t, e.truth, color=colour, **WIDE)
    for e, colour in zip(of, FIVE, strict=False):
        line(axes, t, e.hat, color=colour, linewidth=1.2 if e.truth is not None else 0.7,
             label=e.name)  # fmt: skip
    if any(e.truth is not None for e in of):
        axes.plot([], [], color=MUTED, label="truth", **WIDE)
    for level in within:
        axes.axhline(level, zorder=1, **DASHED)
    low, high = within
    if least is None:
        margin = 0.05 * (high - low)
        axes.set_ylim(low - margin, high + margin)
        axes.plot([], [], label="bound", **DASHED)
    else:
        lines = [e.hat for e in of] + [e.truth for e in of if e.truth is not None]
        zoom(axes, t, lines, window.settled_from_s, least, f"bounds ±{high:g}")
    legend(axes)
