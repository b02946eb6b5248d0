"""`gcs airframe`: what is known of an airframe before it flies."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.judging.airframe_check import AirframeCheck, Channel

DOES_NOT_FLY = 1  # exit code


@click.command(
    epilog="\b\n"
    "Authority  torque beside a level hover, about one axis at a time, and over\n"
    "           inertia\n"
    "Margins    gain: how far the estimates of mass and inertia may be off;\n"
    "           delay: from measurement to rotor; each alone, with all else as\n"
    "           believed\n"
    "Gains      of M-MRAC and its guard, that follow from the airframe or are\n"
    "           pinned in its file\n\n"
    "Exit codes: 0 it flies; 1 its gains are unstable, or hover leaves no room for what is believed;\n"
    "2 the file is invalid, no such vehicle can fly, or the figure cannot be written; 130 interrupted."
)
@click.argument("airframe", metavar="NAME|FILE")
@arguments.FIGURE
@arguments.as_json("Print the result as JSON (keys: gcs_tools/judging/README.md).")
def airframe(airframe: str, figure: Path | None, as_json: bool) -> int:
    """Check an airframe before flight: NAME of a shipped one, or a FILE.toml.

    Prints what its rotors can do beside hovering, the gains that follow from that with their margins,
    and how long the battery lasts. docs/airframes.md describes the file.
    """
    from fcu.interface.airframe import AirframeError, find, read
    from fcu.interface.parameter import ParameterError
    from fcu.kernel.compile import is_cached
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging.airframe_check import airframe_check

    try:
        file = read(find(airframe))
        if not is_cached("governor.speeds"):
            click.echo("compiling, once for this version (for 10 s or so) ...", err=True)
        try:
            found = airframe_check(file)
        except ParameterError as error:
            raise AirframeError(f"{file.path}: {error}") from error
        if figure is not None:
            from gcs_tools.pictures.plot.airframe import save

            save(found, figure)
    except AirframeError as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        raise Failure(f"{error.filename or figure}: {error.strerror}", USAGE) from error
    if as_json:
        print_json(found.as_json())
    else:
        _show(found, PipedConsole(highlight=False))
        if figure is not None:
            print_line(f"{figure}")
    return OK if found.flies else DOES_NOT_FLY


def _show(found: AirframeCheck, console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    name = Path(found.airframe).name.removesuffix(".toml")
    console.print(Text(f"{name},", style="bold"), Text(f"{len(found.rotors)} rotors", style="dim"))
    for why in _why_not(found):
        console.print(Text(why, style="bold yellow"))
    if found.flies:
        console.print(
            Text("It flies:", style="bold green"), "its gains are stable, and hover leaves room."
        )
    for doubt in found.doubts:
        console.print(Text("Is this meant?", style="bold yellow"), Text(f"{doubt}."))
    console.print()

    rows = Table("Hover", "", "", box=None, pad_edge=False, header_style="dim")
    rows.columns[1].justify = "right"
    least, most = found.mass_kg
    rows.add_row("mass", f"{least:g} to {most:g}", "kg, assumed")
    rows.add_row("throttle", f"{100.0 * found.hover_throttle:.0f}", "% of full rotor speed")
    rows.add_row("greatest thrust", f"{found.thrust_to_weight:.2f}", "times the weight")
    minutes, power = found.hover_time_s / 60.0, found.hover_power_w
    rows.add_row("battery", f"{minutes:.1f}", f"min at {power:.0f} W, of the simulated vehicle")
    response, lag = 1e3 * found.rotor_response_s, 1e3 * found.rotor_lag_s
    rows.add_row("rotor response", f"{response:.1f}", f"ms ({lag:.3g} ms lag, compensated)")
    console.print(rows)
    console.print()

    axes = Table(
        "Authority beside hover", "N m", "rad/s\u00b2", box=None, pad_edge=False, header_style="dim"
    )
    for column in axes.columns[1:]:
        column.justify = "right"
    for each in found.authority:
        axes.add_row(each.axis, f"{each.torque_n_m:.3g}", f"{each.acceleration_rad_s2:.3g}")
    console.print(axes)
    console.print()

    loops = Table(
        "Loop",
        "",
        "settles in",
        "gain margin",
        "delay margin",
        box=None,
        pad_edge=False,
        header_style="dim",
    )
    for column in loops.columns[2:]:
        column.justify = "right"
    for channel in found.channels:
        loops.add_row(*_loop(channel))
    console.print(loops)
    console.print()

    guard = Table("Guard", "", "", box=None, pad_edge=False, header_style="dim")
    guard.columns[1].justify = "right"
    guard.add_row("assumed wind", f"{found.wind_m_s:.1f}", "m/s")
    guard.add_row("force left in hover", f"{found.room_n:.2g}", "N, whatever that wind does")
    guard.add_row(
        "torque left in hover",
        f"{found.torque_left_n_m:.2g}",
        "N m of roll and pitch, beside its gusts",
    )
    guard.add_row("speed", f"{found.speed_m_s:.1f}", "m/s at most, governed")
    console.print(guard)
    console.print()

    pins = any(gain.pinned for gain in found.gains)
    titles = ("Gain", "", "", "else") if pins else ("Gain", "", "")
    gains = Table(*titles, box=None, pad_edge=False, header_style="dim")
    gains.columns[1].justify = "right"
    for gain in found.gains:
        row = (gain.key, _value(gain.value), gain.unit)
        follows = Text(_value(gain.follows) if gain.pinned else "", style="dim")
        gains.add_row(*row, *((follows,) if pins else ()))
    if pins:
        console.print(
            Text("Pinned in the file, or follow from it; else: what would follow.", style="dim")
        )
    console.print(gains)


def _why_not(found: AirframeCheck) -> list[str]:
    """What keeps it from flying, in sentences."""
    said = []
    if found.grounded:
        said.append(f"It cannot hover: {found.grounded}.")
    if found.unstable:
        said.append(f"Its gains are unstable: {found.unstable}.")
    if found.room_n < 0.0:
        wind = f"in a wind of {found.wind_m_s:.3g} m/s (guard_wind_m_s)"
        said.append(f"Hover lacks {-found.room_n:.2g} N of force {wind}.")
    if found.torque_left_n_m < 0.0:
        said.append(
            f"Hover lacks {-found.torque_left_n_m:.2g} N m of torque about roll and pitch for gusts"
            " (guard_wind_m_s, guard_wind_rate_m_s2)."
        )
    return said


def _loop(channel: Channel) -> tuple[str, ...]:
    from gcs_tools.judging.airframe_check import MOST_DB, MOST_TICKS, RATE_HZ

    if math.isinf(channel.settles_s):
        return channel.name, "unstable", "", "", ""

    def db(value: float, sign: str) -> str:
        return f"{sign}{value:.1f}" if value < MOST_DB else f"beyond {sign}{MOST_DB:g}"

    late = "" if channel.delay_s < (MOST_TICKS - 1) / RATE_HZ else "at least "
    return (
        channel.name,
        "stable" if channel.stable else "refused",
        f"{channel.settles_s:.2f} s",
        f"{db(channel.gain_down_db, '-')}, {db(channel.gain_up_db, '+')} dB",
        f"{late}{1e3 * channel.delay_s:.0f} ms",
    )


def _value(value: Any) -> str:
    row = value if isinstance(value, tuple | list) else (value,)
    return ", ".join(f"{number:.4g}" for number in row)
