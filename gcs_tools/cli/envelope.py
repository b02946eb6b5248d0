"""`gcs envelope`: what is known of a mission before it flies."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface.options import WholeNumber
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.judging.envelope import Change, Envelope, Noise, Reach

DOES_NOT_HOLD = 1  # exit code
NAMED = {
    "acceleration": "acceleration demanded by the trajectory",
    "speed": "drag of the vehicle's own speed",
    "wind": "drag of the wind",
    "learning": "lag of the estimates",
    "tracking": "correcting the tracking error that this causes",
    "doubt": "unknown mass during a step",
    "noise": "noise of the measurement",
    "steering": "tilts that steer in a wind from below",
}


GOVERN = "govern"
MOST_ITEMS = 30  # of a plan, that are shown
NOT_NECESSARY = (
    "It is sufficient, not necessary: a flight for which it fails may still saturate nothing."
)
DISTANCES, MASS = "setpoint distances, factor", "width of guard_mass_kg"
ALONE = {  # by what is changed
    DISTANCES: "setpoints nearer to the start",
    "f_m": "a lower f_m",
    "guard_wind_m_s": "less wind (guard_wind_m_s)",
    MASS: "a mass known exactly (guard_mass_kg)",
    "flight.curve.speed_max_m_s": "a slower curve (flight.curve.speed_max_m_s)",
    "flight.curve.period_s": "a slower curve (flight.curve.period_s)",
}


@click.command(
    epilog="\b\n"
    "Exact set  the actuators' own limits along the reference trajectory; used by\n"
    "           the guard\n"
    "Ball       the largest ball of forces around hover\n"
    "Paper (31) the paper's condition, equation (31), repaired, at the target\n\n"
    "Each condition is sufficient, not necessary: a flight that fails it may still be fine.\n\n"
    "Exit codes: 0 the condition holds along the mission, or the guard governs what does not fit; 1\n"
    "it fails (or a computed wind saturates something), the gains are unstable, hover has no room for the noise that is believed, or a setpoint cannot be flown as\n"
    "written (too far away or too fast, beyond arena_m, below the ground) and [expect] does not say\n"
    "so; 2 the mission is invalid or the figure cannot be written; 130 interrupted."
)
@click.argument("mission")
@arguments.AIRFRAME
@arguments.SETTINGS
@arguments.FIGURE
@click.option("--worst-wind", "worst", is_flag=True, help="Compute the wind that brings each limit nearest, within what is believed, and the room that it leaves.")  # fmt: skip
@click.option("--parts", type=WholeNumber(1, 20), default=3, show_default=True, help="With --worst-wind: into how many parts the flight is divided, each with winds of its own.")  # fmt: skip
@click.option("--winds", type=click.Path(file_okay=False, path_type=Path), metavar="FOLDER", help="With --worst-wind: write each wind as CSV, and a mission that flies it.")  # fmt: skip
@arguments.as_json("Print the result as JSON (keys: gcs_tools/judging/README.md).")
def envelope(
    mission: str, airframe: str | None, settings: tuple[str, ...], figure: Path | None, worst: bool,
    parts: int, winds: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Check before flight whether MISSION keeps thrust and tilt inside their limits.

    Prints the largest step, speed and wind for which that is certain, which term uses up the
    margin, and what to change. The mission's [law] guard_* keys say what is believed about mass,
    drag, wind, noise and delay.

    With --worst-wind it flies the mission a thousand times at the ends of what is believed, which takes a minute or
    more, and prints by how much thrust, tilt and torque stay inside in the worst wind that it finds.
    """
    if not worst and (given := _given("parts", "winds")):
        raise click.UsageError(f"--{given}: expected with --worst-wind")
    from fcu.guard.responses import UnstableError
    from fcu.interface.airframe import AirframeError
    from fcu.interface.parameter import ParameterError
    from fcu.kernel.compile import is_cached
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging.envelope import envelope as envelope_of
    from gcs_tools.missions.mission import (
        MissionError,
        load,
        once,
        override,
        refuse_script,
        with_airframe,
    )
    from gcs_tools.missions.other_file import meant
    from gcs_tools.missions.plan_file import PlanError

    try:
        chosen = load(mission)
        if airframe is not None:
            chosen = with_airframe(chosen, airframe)
        for setting in once(settings):
            chosen = override(chosen, setting)
        refuse_script(chosen, "gcs envelope")
        if not is_cached("foreseen.along"):
            click.echo("compiling, once for this version (for 10 s or so) ...", err=True)
        if worst:
            from gcs_tools.cli.worst_wind import shown

            return shown(chosen, parts, winds, figure, as_json)
        try:
            from gcs_tools.flight.plan_look import margins

            found = envelope_of(chosen, margins(chosen))
            if figure is not None:
                from gcs_tools.pictures.plot.envelope import save

                save(chosen, found, figure)
        except (ParameterError, AirframeError, UnstableError, PlanError) as error:
            raise MissionError(f"{chosen.source}: {error}") from error
        if as_json:
            print_json(found.as_json())
        else:
            _show(found, PipedConsole(highlight=False))
            if figure is not None:
                print_line(f"{figure}")
    except MissionError as error:
        raise Failure(meant(mission) or error, USAGE) from error
    except OSError as error:
        at = error.filename or figure or "standard output"
        raise Failure(f"{at}: {error.strerror}", USAGE) from error
    drowned = found.noise is not None and bool(found.noise.lack)
    flyable = all(each.expected for each in found.unflyable)
    return OK if (found.holds or found.governed) and flyable and not drowned else DOES_NOT_HOLD


def _given(*options: str) -> str:
    """The first of the options that stands on the command line. Empty if none does."""
    source = click.get_current_context().get_parameter_source
    return next((o for o in options if source(o) is click.core.ParameterSource.COMMANDLINE), "")


def _show(found: Envelope, console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    colour = "green" if found.holds else "yellow"
    console.print(Text(found.mission, style="bold"), Text(f"guard {found.guard}", style="dim"))
    if found.unstable:
        said = f"{found.unstable} is unstable with these gains: a vehicle refuses them."
        console.print(Text(said[:1].upper() + said[1:], style="bold red"))
        console.print(
            "The margins would describe no flight. gcs airframe says whether gains are stable."
        )
        return
    _show_headline(found, console)
    for each in found.unflyable:
        expected = " (expected)" if each.expected else ""
        console.print(Text(f"Not flown as written{expected}: {each.text}.", style="yellow"))
    if found.wind_within:
        console.print(f"{found.wind_within[:1].upper()}{found.wind_within[1:]}.")
    for gap in found.uncovered:
        remedy = f" ({gap.remedy})" if gap.remedy else ""
        console.print(Text(f"Not covered: {gap.said}{remedy}.", style="yellow"))
    console.print()

    of = "At its tightest, as given" if found.governed else "At its tightest"
    spent = Table(of, "N", box=None, pad_edge=False, header_style="dim")
    spent.columns[1].justify = "right"
    none = "" if found.terms.hover > 0.0 else "  <- the actuators cannot carry the believed vehicle"
    spent.add_row(f"margin in hover, to the nearest limit{none}", f"{found.terms.hover:.1f}")
    for name, words in NAMED.items():
        eats = (
            "  <- uses up most" if name == found.terms.largest and found.terms.hover > 0.0 else ""
        )
        spent.add_row(f"  {words}{eats}", _tenths(-getattr(found.terms, name)))
    spent.add_row(
        "left", f"{math.floor(10.0 * found.terms.left) / 10.0:.1f}", style=f"bold {colour}"
    )
    console.print(spent)
    console.print()

    if found.plan:
        _show_plan(found, console)
    believed = Table("Believed", "", "", "", box=None, pad_edge=False, header_style="dim")
    believed.columns[1].justify = "right"
    for belief in found.beliefs:
        believed.add_row(belief.what, belief.value, belief.unit, Text(belief.key, style="dim"))
    console.print(believed)
    if found.noise is not None:
        _show_noise(found.noise, console)
    console.print()

    reach = Table("Certain up to", "", box=None, pad_edge=False, header_style="dim")
    for column in ("exact set", "ball", "paper (31)"):
        reach.add_column(column, justify="right")
    for row in found.reach:
        reach.add_row(row.what, row.unit, *_columns(row))
    console.print(reach)

    if found.plan and not found.holds:
        console.print()
        console.print("Slower fits: MPC_XY_CRUISE and MPC_ACC_HOR of the vehicle, or DO_CHANGE_SPEED in the plan.")  # fmt: skip
    elif not found.holds:
        console.print()
        _show_changes(found, console)
    after = "thrust and tilt are certain from"
    console.print()
    console.print(Text(f"During the first transient of adaptation nothing is certain: {after} {found.transient_s:.2f} s after take-over.", style="dim"))  # fmt: skip
    if found.arrives_s is not None:
        console.print(Text(f"While what is believed holds: from rest within 0.3 m of the first setpoint after {math.ceil(found.arrives_s)} s at most.", style="dim"))  # fmt: skip
    if found.unstated:
        console.print(Text(f"When it arrives is not stated: {found.unstated}.", style="dim"))
    for way in found.arrivals:
        if way.within_s is not None and way.within_s > way.stands_s:
            console.print(Text(f"The setpoint of {way.at_s:g} s stands for {way.stands_s:g} s; to be within 0.3 m of it, from rest at the one before, may take {math.ceil(way.within_s)} s.", style="yellow"))  # fmt: skip


def _show_headline(found: Envelope, console: Console) -> None:
    """Print whether the condition holds for what will be flown, and what that means."""
    from rich.text import Text

    if found.holds:
        said, style, more = "The condition holds:", "bold green", _sentence(found)
    elif found.governed:
        said, style = "With the guard the condition holds:", "bold green"
        more = "the vehicle flies the setpoints more gently than given."
    else:
        said, style, more = "The condition fails:", "bold yellow", _sentence(found)
    console.print(Text(said, style=style), more)
    if found.governed:
        console.print(
            f"For the setpoints as given it fails: {_sentence(found)} The tables say where that goes."
        )
    elif not found.holds and found.guard == GOVERN:
        console.print("The guard cannot help: hover alone leaves no margin for what is believed.")
    if found.refused:
        console.print(f"The vehicle refuses it: {found.refused}.")
    if not found.holds:
        console.print(Text(NOT_NECESSARY, style="dim"))
    if (found.holds or found.governed) and found.noise is not None and found.noise.lack:
        console.print(Text("But noise may saturate the torque: see below.", style="yellow"))


def _show_plan(found: Envelope, console: Console) -> None:
    """Print the margin along a plan, item by item."""
    from rich.table import Table
    from rich.text import Text

    given = ", as given" if found.governed else ""
    table = Table(f"On the way to item{given}", "", "N left", "after, s", box=None, pad_edge=False, header_style="dim")  # fmt: skip
    table.columns[2].justify = table.columns[3].justify = "right"
    least = min(each.margin_n for each in found.plan)
    rows = found.plan if len(found.plan) <= MOST_ITEMS else sorted(found.plan, key=lambda each: each.margin_n)[:MOST_ITEMS]  # fmt: skip
    for each in rows:
        mark = "  <- least" if each.margin_n == least else ""
        left = Text(f"{math.floor(10.0 * each.margin_n) / 10.0:.1f}", style="yellow" if each.margin_n < 0.0 else "")  # fmt: skip
        table.add_row(str(each.item), f"{each.command}{mark}", left, f"{each.at_s:.1f}")
    console.print(table)
    if len(found.plan) > MOST_ITEMS:
        console.print(Text(f"The {MOST_ITEMS} of {len(found.plan)} items with least.", style="dim"))
    console.print()


def _show_noise(noise: Noise, console: Console) -> None:
    from rich.text import Text

    console.print(
        f"Torque of roll and pitch in hover: {noise.there_n_m:.1f} N m, of which a gust takes"
        f" {noise.gust_n_m:.1f} and noise {noise.noise_n_m:.1f}; left {noise.left_n_m:.1f}."
    )
    if noise.lack:
        console.print(Text(f"Noise may saturate something: {noise.lack}.", style="yellow"))
    elif noise.per_hour is None:
        console.print("There is room for what such a noise does at most.")
    else:
        console.print(
            f"White noise saturates something with a probability of {noise.per_hour:.1g} an hour at most."
        )


def _show_changes(found: Envelope, console: Console) -> None:
    from rich.text import Text

    would = [
        _change(change, change.would_do) for change in found.changes if change.would_do is not None
    ]
    if found.can_be_governed:
        would.append('law.guard="govern": the vehicle flies the setpoints more gently')
    would_not = [
        ALONE.get(change.what, change.what) for change in found.changes if change.would_do is None
    ]
    given = "the setpoints as given" if found.governed else "it"
    for title, lines in (
        (f"Any one of these changes would make {given} fit:", would),
        ("None of these changes would do alone:", would_not),
    ):
        if lines:
            console.print(Text(title, style="dim"))
            for line in lines:
                console.print(f"  {line}")


def _change(change: Change, would_do: float) -> str:
    """A change that would make the mission fit."""
    if change.what == DISTANCES:
        of_curve = [setting for setting in change.settings if "curve" in setting]
        how = ", ".join(of_curve) or ("flight.setpoints" if change.settings else "flight.items")
        about = "" if change.settings else "about "
        return f"setpoint distances scaled to {about}{_down(100.0 * would_do)} % ({how})"
    if change.what == MASS:
        return ALONE[MASS]
    to = _down(would_do) if would_do < change.now else _up(would_do)
    return f"{change.what} {change.now:.3g} -> {to} {change.unit}".rstrip()


def _tenths(value: float) -> str:
    """One digit behind the point, and no minus before a zero."""
    return f"{round(value, 1) + 0.0:.1f}"


def _columns(row: Reach) -> list[str]:
    """The certain values, rounded down."""
    columns = (row.exact, row.ball, row.theorem)
    return ["-" if v is None else f"{math.floor(10.0 * v) / 10.0:.1f}" for v in columns]


def _down(value: float) -> str:
    """Three digits, rounded down: so much still holds."""
    step = 10.0 ** (math.floor(math.log10(value)) - 2) if value > 0.0 else 1.0
    return f"{math.floor(value / step) * step:.3g}"


def _up(value: float) -> str:
    """Three digits, rounded up."""
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / step) * step:.3g}"


def _sentence(found: Envelope) -> str:
    how = "left" if found.holds else "short"
    size = math.ceil(-10.0 * found.margin_n) / 10.0 if found.margin_n < 0.0 else found.margin_n
    where = " on the way to a setpoint that is refused" if found.refused else ""
    return f"{size:.1f} N {how} at {found.at_s:.1f} s, its tightest moment{where}."
