"""The panels of the monitor, each answering one question. `width`: columns inside its frame."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import zip_longest

import numpy as np
from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

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
from gcs_tools.pictures.quantities import (
    CONTRADICTED,
    ENU,
    QUANTITIES,
    ROTORS,
    Quantity,
    parts,
    told,
)

OF_LATE = f"over the last {RECENT_S:.0f} s"
_LEVEL = {"warning": WARN, "error": BAD, "fatal": BAD}


def header(r: Readings) -> Panel:
    """What flies, and where in its time it is."""
    vehicle = r.follower.vehicle
    words = Text.assemble((r.flight.title, "bold"), "   ", number(r.t, 2, "s"))
    words.append(f"   × {plain(r.speed(), 2)}", style=DIM)
    words.append(f"   {r.flight.status(r.t)}", style=GOOD)
    if progress := r.flight.plans.at(math.inf).progress:
        words.append(f"   {progress}")
    if vehicle.gone:
        words.append("   gone: it is on the bus no more", style=BAD)
    elif "replay_of" in vehicle.about:
        words.append("   a replay", style=WARN)
    about = f"vehicle {vehicle.about.get('vehicle')}, run {vehicle.about.get('run')}"
    return Panel(words, subtitle=about, subtitle_align="right", border_style=DIM, padding=(0, 2))


def _quantities(r: Readings, title: str, width: int) -> list[Table]:
    """The quantities of a panel: those held against a truth, and those that are not."""
    shown = [q for q in QUANTITIES if q.panel == title and r.flight.shows(q)]
    room = width - max((len(label) for q in shown for label in _labels(q)), default=0)
    held, others = grid(5), grid(3)
    held.add_row(*heads("", "estimate", "truth", "error", ""))
    for quantity in shown:
        for row in _rows(r, quantity, room):
            (held if len(row) == 5 else others).add_row(*row)
    return [table for table, least in ((held, 2), (others, 1)) if table.row_count >= least]


def _labels(q: Quantity) -> list[str]:
    return [q.short] if q.size else [q.short + word * (len(q.labels) > 1) for word in q.labels]


def _rows(r: Readings, q: Quantity, room: int) -> Iterator[tuple[RenderableType, ...]]:
    """A quantity, or each of its components: label, numbers, and a gauge or a sparkline."""
    columns = [q.columns] if q.size else [(name,) for name in q.columns]
    ends, digits = q.limits(r.flight.limits), q.digits
    for label, names, truth in zip_longest(_labels(q), columns, q.truth):
        t, values = r.size(names)
        of_two_sides = len([*told(names)]) > len(names)  # of which one may have come alone
        known = values[np.isfinite(values)] if of_two_sides else values
        now = float(known[-1]) if r.flies and len(known) else math.nan
        if ends:
            yield label, number(now, digits, q.unit), gauge(now, *ends, room - 18)
        elif truth is not None:
            is_true = r.now(r.flight.series(truth))
            off = number(now - is_true, digits)
            drawn = spark(t, values, room - 32)
            yield label, number(now, digits), true(is_true, digits), off, drawn
        else:
            if q.logarithmic or q.fine:
                values = np.log10(np.maximum(values, 10.0 ** -(digits + 1)))
            low = 0.0 if q.size and not q.fine else None
            yield label, number(now, digits, q.unit), spark(t, values, room - 18, low)


def tracking(r: Readings, width: int) -> Panel:
    """Does it go where the reference goes, and does the predictor hold?"""
    places = grid(4)
    places.add_row(*heads("m", *ENU))
    for label, name in (
        ("position", "state.r_E"), ("reference", "outputs.reference.r_m"), ("setpoint", "setpoint.r_c")
    ):  # fmt: skip
        places.add_row(label, *(number(value, 2) for value in r.vector(name)))
    rms = Text(f"off the reference, RMS {OF_LATE}: ", style=DIM)
    rms += number(r.rms(r.flight.flown("position_error")), 3, "m")
    return panel("Tracking", places, *_quantities(r, "Tracking", width), rms)


def limits(r: Readings, width: int) -> Panel:
    """How far is it from what its actuators can do?"""
    limits = r.flight.limits
    u = [r.last(name) for name in parts("command.u", ROTORS[: len(limits.x)])]
    greatest = max((x for x in u if math.isfinite(x)), default=math.nan)
    blocks = " ".join(bar(x) if math.isfinite(x) else "·" for x in u)
    style = BAD if greatest > 0.98 else GOOD
    *held, table = _quantities(r, "Limits", width) or [grid(3)]
    table.add_row("rotors", number(greatest, 2, "of 1"), Text(blocks, style=style))
    words = Text(f"at a limit {OF_LATE}:", style=DIM)
    for label in ("thrust", "tilt", "torque", "yaw"):
        at = r.recent(r.flight.flown(f"outputs.saturation.{label}"))
        part = float(at.mean()) if len(at) else math.nan
        style = DIM if math.isnan(part) else BAD if part > 0.0 else GOOD
        words.append(f" {label} {plain(100.0 * part, 0)} %", style=style)
    between = (
        f"thrust {limits.T_min:g} to {limits.T_max:g} N, tilt to {math.degrees(limits.phi_star):g}°"
    )
    guard = [_margin(r), _condition(r)] if r.flight.tells(["guard.margin.force"]) else []
    return panel("Limits", *held, table, *guard, words, Text(between, style=DIM))


def _margin(r: Readings) -> Text:
    """What is left before the nearest limit, and of tilt: now, and the least of late."""
    now, of_late = Text("margin: ", style=DIM), Text(f"   least {OF_LATE}: ", style=DIM)
    for name, scale, unit in (("force", 1.0, " N "), ("tilt", 180.0 / math.pi, "° ")):
        found = scale * r.recent(r.flight.flown(f"guard.margin.{name}"))
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
    doubted = [sign for sign in CONTRADICTED if r.last(f"guard.contradicted.{sign}") > 0.5]
    if doubted:
        words.append(f"   not as believed: {', '.join(doubted)}", style=WARN)
    return words


def estimates(r: Readings, width: int) -> Panel | None:
    """Does it learn what is true?"""
    tables = _quantities(r, "Estimates", width)
    if not tables:
        return None
    held = r.last("internals.flags.projected") > 0.5
    note = "projection holds one at its bound" if held else "all inside their bounds"
    note = note if r.flies else "the law does not fly"
    return panel("Estimates", *tables, Text(note, style=WARN if held else DIM))


def wind(r: Readings, width: int) -> Panel:
    """What wind does it see, and what disturbs its turning?"""
    rms = Text(f"wind off, level, RMS {OF_LATE}: ", style=DIM)
    rms += number(r.rms(r.flight.flown("wind_error")), 2, "m/s")
    note = Text(f"if drag is {r.believed_drag} N/(m/s)² and mass known", style=DIM)
    air = Text("rotation of the air: ", style=DIM)
    for value in r.vector("w_air_B"):
        air += true(value, 2).append(" ")
    air.append("rad/s", style=DIM)
    return panel("Wind", *_quantities(r, "Wind", width), rms, note, air)


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
        Text(f"{event.t:8.2f}  {event.shown}", style=_LEVEL.get(event.level, ""), no_wrap=True)
        for event in list(r.follower.events)[-height:]
    ]
    for line in lines:
        line.overflow = "ellipsis"
    return panel("Events", *(lines or [Text("none yet", style=DIM)]))
