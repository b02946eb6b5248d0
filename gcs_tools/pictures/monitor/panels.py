"""The panels of the monitor, each answering one question. `width`: columns inside its frame."""

from __future__ import annotations

import math
import time

import numpy as np
from rich.panel import Panel
from rich.text import Text

from gcs_tools.pictures.history import ROTORS, XYZ, Series
from gcs_tools.pictures.monitor.readings import RECENT_S, Readings
from gcs_tools.pictures.monitor.widgets import (
    BAD,
    DIM,
    GOOD,
    WARN,
    bar,
    gauge,
    grid,
    heads,
    number,
    panel,
    percentiles,
    plain,
    spark,
    true,
)

ENU = ("east", "north", "up")
OF_LATE = f"over the last {RECENT_S:.0f} s"
_LEVEL = {"warning": WARN, "error": BAD, "fatal": BAD}


def header(r: Readings) -> Panel:
    """What flies, and where in its time it is."""
    vehicle = r.follower.vehicle
    words = Text.assemble((r.flight.title, "bold"), "   ", number(r.t, 2, "s"))
    words.append(f"   × {plain(r.speed(), 2)}", style=DIM)
    words.append(f"   {r.flight.status(r.t)}", style=GOOD)
    if vehicle.gone:
        words.append("   gone: it is on the bus no more", style=BAD)
    elif "replay_of" in vehicle.about:
        words.append("   a replay", style=WARN)
    about = f"vehicle {vehicle.about.get('vehicle')}, run {vehicle.about.get('run')}"
    return Panel(words, subtitle=about, subtitle_align="right", border_style=DIM, padding=(0, 2))


def tracking(r: Readings, width: int) -> Panel:
    """Does it go where the reference goes, and does the predictor hold?"""
    places = grid(4)
    places.add_row(*heads("m", *ENU))
    for label, name in (
        ("position", "state.r_E"), ("reference", "outputs.reference.r_m"), ("setpoint", "setpoint.r_c")
    ):  # fmt: skip
        places.add_row(label, *(number(value, 2) for value in r.vector(name)))
    errors = grid(3)
    for label, series, unit, digits in (
        ("off the reference", r.off_reference(), "m", 3),
        ("velocity predicted off", r.norm("internals.prediction.v_til"), "m/s", 4),
        ("rate predicted off", r.norm("internals.prediction.w_til"), "rad/s", 4),
    ):
        t, values = series
        now = r.now(series) if r.flies else math.nan
        drawn = np.log10(np.maximum(values, 10.0 ** -(digits + 1)))
        errors.add_row(label, number(now, digits, unit), spark(t, drawn, width - 40))
    rms = Text(f"off the reference, RMS {OF_LATE}: ", style=DIM)
    return panel("Tracking", places, errors, rms + number(r.rms(r.off_reference()), 3, "m"))


def limits(r: Readings, width: int) -> Panel:
    """How far is it from what its actuators can do?"""
    told, wide = r.flight.limits, width - 23
    table = grid(3)
    T_c = r.last("outputs.T_c") if r.flies else math.nan
    table.add_row("thrust", number(T_c, 1, "N"), gauge(T_c, told.T_min, told.T_max, wide))
    star = math.degrees(told.phi_star)
    for label, axis in (("roll", "x"), ("pitch", "y")):
        angle = math.degrees(r.last(f"outputs.angles_c.{axis}")) if r.flies else math.nan
        table.add_row(label, number(angle, 1, "°"), gauge(angle, -star, star, wide))
    u = [r.last(f"command.u.{rotor}") for rotor in ROTORS]
    greatest = max((x for x in u if math.isfinite(x)), default=math.nan)
    blocks = " ".join(bar(x) if math.isfinite(x) else "·" for x in u)
    style = BAD if greatest > 0.98 else GOOD
    table.add_row("rotors", number(greatest, 2, "of 1"), Text(blocks, style=style))
    t, off = r.norm("internals.achieved.delta_u")
    now = r.now((t, off)) if r.flies else math.nan
    table.add_row("Δu", number(now, 2, "N"), spark(t, off, wide, low=0.0))
    words = Text(f"at a limit {OF_LATE}:", style=DIM)
    for label in ("thrust", "tilt", "rotor"):
        held = r.recent(r.flown(f"outputs.saturation.{label}"))
        part = float(held.mean()) if len(held) else math.nan
        style = DIM if math.isnan(part) else BAD if part > 0.0 else GOOD
        words.append(f" {label} {plain(100.0 * part, 0)} %", style=style)
    between = f"thrust {told.T_min:g} to {told.T_max:g} N, tilt to {star:g}°"
    return panel("Limits", table, _margin(r), _condition(r), words, Text(between, style=DIM))


def _margin(r: Readings) -> Text:
    """What is left before the nearest limit, and of tilt: now, and the least of late."""
    now, of_late = Text("margin: ", style=DIM), Text(f"   least {OF_LATE}: ", style=DIM)
    for name, scale, unit in (("force", 1.0, " N "), ("tilt", 180.0 / math.pi, "° ")):
        found = scale * r.recent(r.flown(f"guard.margin.{name}"))
        left = scale * r.last(f"guard.margin.{name}") if r.flies else math.nan
        least = float(found.min()) if len(found) else math.nan
        for words, value in ((now, left), (of_late, least)):
            style = BAD if value < 0.0 else "bold" if math.isfinite(value) else DIM
            words.append(plain(value, 1) + unit, style=style)
    return now + of_late


def _condition(r: Readings) -> Text:
    """Whether the demand stays inside whatever comes, and what the guard does."""
    by = r.last("guard.margin.condition") if r.flies else math.nan
    words = Text("condition: ", style=DIM)
    if math.isnan(by):
        return words.append("-", style=DIM)
    holds = f"holds by {plain(by, 1)} N" if by >= 0.0 else f"misses {plain(-by, 1)} N"
    words.append(holds, style=GOOD if by >= 0.0 else WARN)
    if r.last("guard.governed") > 0.5:
        words.append("   governed", style=WARN)
    return words


def estimates(r: Readings, width: int) -> Panel:
    """Does it learn what is true?"""
    table = grid(5)
    table.add_row(*heads("", "estimate", "truth", "error", ""))

    def line(label: str, name: str, truth: Series, digits: int) -> None:
        t, values = r.flight.series(name)
        estimate = float(values[-1]) if r.flies and len(values) else math.nan
        is_true = r.now(truth)
        off = number(estimate - is_true, digits)
        drawn = spark(t, values, width - 47)
        table.add_row(label, number(estimate, digits), true(is_true, digits), off, drawn)

    for axis, name in zip(XYZ, ENU, strict=True):
        line(f"drag/mass {name}", f"state.estimates.s_v_hat.{axis}", r.drag_over_mass(axis), 2)
    line("mass, kg", "state.estimates.m_hat", r.flight.series("m"), 2)
    for axis in XYZ:
        line(f"inertia {axis}", f"state.estimates.J_hat.{axis}", r.flight.series(f"J.{axis}"), 3)
    held = r.last("internals.flags.projected") > 0.5
    note = "projection holds one at its bound" if held else "all inside their bounds"
    note = note if r.flies else "the law does not fly"
    return panel("Estimates", table, Text(note, style=WARN if held else DIM))


def wind(r: Readings, width: int) -> Panel:
    """What wind does it see, and what disturbs its turning?"""
    table = grid(4)
    table.add_row(*heads("m/s", "estimate", "truth", "error"))
    estimate, truth = r.vector("wind.v_air_E"), r.vector("v_air_E")
    for name, e, v in zip(ENU[:2], estimate, truth, strict=False):
        table.add_row(name, number(e, 2), true(v, 2), number(e - v, 2))
    table.add_row(ENU[2], Text("not known", style=DIM), true(truth[2], 2))
    rms = Text(f"off, level, RMS {OF_LATE}: ", style=DIM) + number(r.rms(r.wind_error()), 2, "m/s")
    note = Text(f"if drag is {r.believed_drag} N/(m/s)² and mass known", style=DIM)
    turning = grid(3)
    turning.add_row(*heads("angular disturbance", "estimate", ""))
    for axis, name in zip(XYZ, ("roll", "pitch", "yaw"), strict=True):
        t, s = r.flight.series(f"state.estimates.s_w_hat.{axis}")
        now = r.last(f"state.estimates.s_w_hat.{axis}") if r.flies else math.nan
        turning.add_row(name, number(now, 3, "rad/s²"), spark(t, s, width - 39))
    air = Text("rotation of the air: ", style=DIM)
    for value in r.vector("w_air_B"):
        air += true(value, 2).append(" ")
    return panel("Wind", table, rms, note, turning, air.append("rad/s", style=DIM))


def bus(r: Readings, _width: int) -> Panel:
    """Does everything arrive, and in time?"""
    vehicle, now = r.follower.vehicle, time.monotonic()
    table = grid(4)
    for label, who in (("flight controller", "fcu"), ("plant", "plant")):
        counted = vehicle.counted.get(f"/{who}/timing")
        there, lost = who in vehicle.alive, r.lost(who)
        table.add_row(
            label,
            Text("there" if there else "not there", style=GOOD if there else BAD),
            f"{counted.rate_hz(now):.0f} ticks/s" if counted else "-",
            Text(f"{lost} lost on the way", style=BAD if lost else DIM),
        )
    lines = grid(2)
    lines.add_row("cycle", percentiles(1e6 * r.recent(r.flight.series("timing.cycle"))))
    late = 1e6 * r.recent(r.flight.series("timing.late"))
    none = Text("no deadlines at full speed", style=DIM)
    lines.add_row("lateness", percentiles(late) if len(late) else none)
    lines.add_row("load", number(100.0 * r.last("timing.load"), 1, "% of the control period"))
    counts = Text()
    for label, name in (
        ("slips", "slips"), ("resent", "resent"), ("refused", "refused"),
        ("not recorded", "unrecorded"), ("not published", "unpublished"),
    ):  # fmt: skip
        n = r.last(f"timing.{name}")
        counts.append(f"{label} {plain(n, 0)}  ", style=BAD if n > 0.0 else DIM)
    counts.append(f"not the vehicle's {r.strange}", style=BAD if r.strange else DIM)
    return panel("Time and bus", table, lines, counts)


def events(r: Readings, height: int) -> Panel:
    """What happened? `height`: lines inside the frame."""
    lines = [
        Text(f"{event.t:8.2f}  {event.text}", style=_LEVEL.get(event.level, ""), no_wrap=True)
        for event in list(r.follower.events)[-height:]
    ]
    for line in lines:
        line.overflow = "ellipsis"
    return panel("Events", *(lines or [Text("none yet", style=DIM)]))
