"""What the page says beside scene and charts: a style, a heading, the keys to the colours."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape

from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.view.multicopter import SHARES, Colour
from gcs_tools.pictures.view.plan import INSIDE, OUTSIDE, PLAN
from gcs_tools.pictures.view.scene import AIR, FLOWN, REFERENCE, SETPOINT, TRUE_AIR


def _css(colour: Colour) -> str:
    return f"rgb{tuple(int(c) for c in colour)}"


STYLE = """<style>
.caption { display: flex; align-items: baseline; gap: 9px; font-size: 11.5px; color: #444;
  white-space: nowrap; overflow: hidden; margin: 4px 16px -14px 6px; line-height: 1.4; }
.caption b { color: #222; font-size: 12px; }
.caption i { font-style: normal; color: #888; margin: 0 auto 0 -5px; }
.caption span::before, .key li::before { content: ""; display: inline-block; width: 9px;
  height: 9px; border-radius: 2px; background: var(--c); margin-right: 4px; }
.caption code, .caption em, .told code { font-family: ui-monospace, Menlo, Consolas, monospace;
  font-size: 11px; font-style: normal; color: #111; background: none; padding: 0;
  white-space: pre; }
.caption em { color: #8a8a8a; margin-left: 3px; }
.uplot-container { border: none !important; background: none !important; }
.heading { margin: 6px 12px 4px 12px; font-size: 12px; color: #666; line-height: 1.35; }
.heading b { display: block; font-size: 13px; color: #222; margin-bottom: 3px; }
.told { display: grid; grid-template-columns: auto repeat(4, auto); gap: 1px 6px;
  margin: 0 12px; font-size: 12px; color: #555; }
.told code, .told i { text-align: right; font-style: normal; }
.told i { color: #888; font-size: 11px; }
.plan { margin: 2px 12px; font-size: 12px; color: #555; }
.key { list-style: none; margin: 2px 12px; padding: 0; font-size: 11.5px; color: #444;
  display: grid; grid-template-columns: 1fr 1fr; gap: 1px 8px; }
.bar { height: 8px; border-radius: 2px; margin: 6px 12px 1px 12px; }
.ends { display: flex; justify-content: space-between; font-size: 10.5px; color: #777;
  margin: 0 12px 8px 12px; }
</style>"""


def heading(title: str, kind: str) -> str:
    """The title of the flight, and what one is looking at."""
    return f'{STYLE}<div class="heading"><b>{escape(title)}</b>{escape(kind)}</div>'


def told(flight: FlightHistory, now: float) -> str:
    """Time, place, speed and errand of the vehicle at `now` (s)."""
    said = _row("time", [now], "s") + "<i></i><i>east</i><i>north</i><i>up</i><i></i>"
    said += _row("position", flight.vector("state.r_E", now), "m")
    said += _row("velocity", flight.vector("state.v_E", now), "m/s")
    if flight.value("engaged", now) > 0.5:
        said += _row("setpoint", flight.vector("setpoint.r_c", now), "m")
    progress = flight.plans.at(now).progress
    plan = f'<div class="plan" data-told="plan">plan: {escape(progress)}</div>' if progress else ""
    return f'<div class="told">{said}</div>{plan}'


def _row(name: str, values: Iterable[float], unit: str) -> str:
    """A name, up to three numbers of one unit to the right, the unit."""
    words = (f"{value:.3f}" if math.isfinite(value) else "–" for value in values)
    cells = [f"<code>{word}</code>" for word in words]
    cells = ["<i></i>"] * (3 - len(cells)) + cells
    return f'<span data-told="{name}">{name}</span>{"".join(cells)}<i>{unit}</i>'


def key(with_plan: bool) -> str:
    """What the colours of the scene mean. `with_plan`: those of a plan too."""
    meanings: tuple[tuple[str, Colour], ...] = (
        ("flown", FLOWN), ("reference model", REFERENCE), ("wind", TRUE_AIR),
        ("wind, estimate", AIR), ("setpoint", SETPOINT), ("front arms", SETPOINT),
    )  # fmt: skip
    if with_plan:
        meanings += ("plan", PLAN), ("stay inside", INSIDE), ("stay outside", OUTSIDE)
    items = "".join(f'<li style="--c:{_css(c)}">{escape(word)}</li>' for word, c in meanings)
    stops = ", ".join(f"rgb({r},{g},{b})" for r, g, b in SHARES.tolist())
    return (
        f'<ul class="key">{items}</ul><div class="bar" style="background:linear-gradient(90deg,{stops})">'
        '</div><div class="ends"><span>0</span><span>thrust of a rotor over its greatest</span>'
        "<span>1</span></div>"
    )
