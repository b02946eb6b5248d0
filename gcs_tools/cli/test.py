"""`gcs test`."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

import click

from fcu.interface.options import Number
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, report_rejected
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED, USAGE
from gcs_tools.flight.interrupts import interrupts_wait

# the limits of the rotors and of tilt, which nothing runs into
LIMITS = {f"{what}_saturated_fraction": 0.0 for what in ("thrust", "tilt", "torque")}


@click.command(
    context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
    epilog="Exit codes: 0 it flew, landed and ended with 0, 1 it did not, 2 invalid command line, 3 the\n"
    "script was killed, a process died or stalled or a port was busy, 130 interrupted (also by SIGTERM\n"
    "and SIGHUP).\n\n"
    "Options stand before SCRIPT, what follows is the script's: gcs test --speed 4 square.py {url}. The\n"
    "words in braces, and how a script can fail: docs/script-missions.md.",
)
@click.argument("script", metavar="SCRIPT")
@click.argument("script_arguments", nargs=-1, type=click.UNPROCESSED, metavar="[ARGS]...")
@arguments.wall_speed("1")
@click.option("--held", is_flag=True, help="Let time stand until SCRIPT has answered, in place of --speed: twice flown, it is the same flight.")  # fmt: skip
@click.option("--duration", "duration_s", type=Number(0.01, 3600.0), default=300.0, show_default=True, metavar="S", help="Simulated seconds within which the script has to end.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the results; default: a new one in runs/.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="DIR may hold an earlier run, which is removed.")
@click.option("--junit", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also write a JUnit report.")  # fmt: skip
@arguments.LAW
@arguments.AIRFRAME
@arguments.SETTINGS
@arguments.FREE_INSTANCE
@arguments.as_json("Print the result as JSON.")
def test(
    script: str, script_arguments: tuple[str, ...], speed: float | None, held: bool, duration_s: float,
    out: Path | None, overwrite: bool, junit: Path | None, law: str | None, airframe: str | None,
    settings: tuple[str, ...], instance: int | None, as_json: bool,
) -> int:  # fmt: skip
    """Run SCRIPT against a vehicle on the ground: a flight and a verdict without a mission file.

    Expects that the vehicle arms, flies and lands, that it is not lost, that thrust, tilt and torque
    stay below their limits in the air, and that SCRIPT ends with 0.
    SCRIPT is a Python file, or a program. Criteria of your own: --set expect.KEY=VALUE.
    """
    with interrupts_wait():
        from gcs_tools.cli.terminal import Terminal
        from gcs_tools.flight.display import Display
        from gcs_tools.flight.run import fly_missions
        from gcs_tools.flight.run_folder import UsageError
        from gcs_tools.judging import result
        from gcs_tools.missions.flight_table import HELD
        from gcs_tools.missions.mission import MissionError, from_tables

        try:
            _check(script, speed, held)
            script_arguments = _of_the_script(script_arguments)
        except Failure as error:
            report_rejected([Path(script).stem], error, junit, are_scripts=True)
            raise
        is_python = script.endswith(".py")
        words = [*(["python"] if is_python else []), script, *script_arguments]
        flight = {
            "duration_s": duration_s, "ground_z_m": 0.0, "start": {"on_ground": True},
            "script": shlex.join(words), "pace": HELD if held else "real",
        }  # fmt: skip
        try:
            title = "A ground script flies, and lands."
            mission = from_tables(
                Path(script).stem, {"title": title, "flight": flight, "expect": LIMITS}
            )
            results = fly_missions(
                [mission], speed=None if held else speed, out=out, law=law, airframe=airframe, settings=settings,
                instance=instance, display=Display() if as_json else Terminal(), overwrite=overwrite,
                allow_commands=True,
            )  # fmt: skip
        except (MissionError, UsageError) as error:
            report_rejected([Path(script).stem], error, junit, are_scripts=True)
            raise Failure(error, USAGE) from error
        code = max((each.exit_code for each in results), default=INTERRUPTED)
        if junit is not None:
            try:
                result.junit(results, junit, are_scripts=True)
            except result.ResultError as error:
                click.echo(f"Error: {error}", err=True)
                code = max(code, INFRASTRUCTURE)
        if as_json:
            print_json([dataclasses.asdict(each) for each in results])
    return code


def _check(script: str, speed: float | None, held: bool) -> None:
    """Raise Failure for what cannot be tested."""
    if held and _is_given("speed"):
        raise Failure("--held and --speed: time is held, or has a speed; give one", USAGE)
    if speed is None:
        why = "a script runs by the wall clock; give a number, or --held"
        raise Failure(f"--speed max: {why}", USAGE)
    if script.startswith("-"):
        raise Failure(f"{script}: no such option (gcs test --help lists them)", USAGE)
    if script.endswith(".toml"):
        raise Failure(f"{script}: a mission: gcs fly {script}", USAGE)
    if script.endswith(".py") and not Path(script).is_file():
        raise Failure(f"{script}: no such file", USAGE)


def _is_given(name: str) -> bool:
    """True if an option stands on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is click.core.ParameterSource.COMMANDLINE


def _of_the_script(arguments: tuple[str, ...]) -> tuple[str, ...]:
    """The words behind SCRIPT. Raises Failure for an option of ours that stands there."""
    if arguments[:1] == ("--",):
        return arguments[1:]
    ours = {name for option in test.params for name in option.opts if name.startswith("--")}
    for word in arguments:
        if word.partition("=")[0] in ours:
            raise Failure(
                f"{word}: stands behind SCRIPT, so it is the script's. Put it before SCRIPT; if it is meant"
                " for the script, put -- before the script's arguments",
                USAGE,
            )
    return arguments
