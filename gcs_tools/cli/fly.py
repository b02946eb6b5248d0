"""`gcs fly`."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from fcu.interface.options import Number, WholeNumber
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, report_rejected
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED, USAGE
from gcs_tools.flight.interrupts import interrupts_wait


@click.command(
    epilog="Exit codes: 0 all expectations met, 1 at least one missed, 2 invalid command line or\n"
    "mission, 3 a process died or stalled or a port was busy, 130 interrupted (also by SIGTERM and\n"
    "SIGHUP). With several missions: the highest; one that is invalid does not keep the others from\n"
    "flying.\n\n"
    "MISSION is a file, the name of a shipped mission, 'benchmark' for all missions of that folder, or\n"
    "'FOLDER#1234', a flight of a campaign in FOLDER. Of the shipped missions airframe_... and\n"
    "benchmark/... are for every airframe, the others for the S1000 (docs/missions.md)."
)
@click.argument("missions", nargs=-1, required=True, metavar="MISSION...")
@arguments.speed("max")
@arguments.SEEDS
@click.option("--rate", "rate_hz", type=float, metavar="HZ", help="Control rate, Hz; default: the mission's.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the results; default: a new one in runs/.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="DIR may hold an earlier run, which is removed.")
@click.option("--junit", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also write a JUnit report.")  # fmt: skip
@arguments.LAW
@arguments.AIRFRAME
@click.option("--controller", metavar="COMMAND", help="Run COMMAND in place of the flight controller (docs/flight-controller-of-your-own.md).")  # fmt: skip
@click.option("--controller-timeout", "controller_timeout_s", type=Number(min=0.0, min_open=True), default=30.0, show_default=True, metavar="S", help="Seconds within which COMMAND opens its port.")  # fmt: skip
@arguments.SETTINGS
@arguments.PARAMS
@click.option(
    "--in-process",
    is_flag=True,
    help="Fly flight controller and simulator in one process, without sockets: the same flight.",
)
@arguments.ALLOW_COMMANDS
@arguments.as_json("Print the results as JSON.")
@click.option("--publish/--no-publish", default=None, help="Publish every tick on Zenoh; default: only if --speed is not max.")  # fmt: skip
@arguments.ZENOH
@arguments.FREE_INSTANCE
@click.option("-j", "--jobs", type=WholeNumber(1), metavar="N", help="Missions to fly at a time; default: as many as cores, or 1 with --speed, --instance or publishing.")  # fmt: skip
@click.option("--figure", type=click.Choice(["always", "failed", "never"]), help="Flights to draw flight.png of; default: always for one mission, failed for several.")  # fmt: skip
@click.option("--record", type=click.Choice(["full", "light", "none"]), default="full", show_default=True, help="Ticks in flight.mcap: all, 100 a second, or no file. The verdict always uses every tick.")  # fmt: skip
def fly(
    missions: tuple[str, ...], speed: float | None, seed: int | range | None, rate_hz: float | None,
    out: Path | None, junit: Path | None, law: str | None, airframe: str | None,
    controller: str | None, controller_timeout_s: float, settings: tuple[str, ...], in_process: bool,
    as_json: bool, publish: bool | None, zenoh: Path | None, instance: int | None,
    jobs: int | None, figure: str | None, record: str, overwrite: bool, allow_commands: bool, params: tuple[str, ...],
) -> int:  # fmt: skip
    """Fly each MISSION and compare it with its expectations.

    Starts a flight controller and a simulator, sends the mission over MAVLink as a ground script
    would, compares the flight with the mission's [expect], and stops both. Setpoints that stand for
    5 s are expected to be reached, whether [expect] says so or not.
    """
    with interrupts_wait():  # what an interruption has begun is told in full
        from gcs_tools.cli.campaign_refly import CampaignFlights
        from gcs_tools.cli.terminal import Terminal
        from gcs_tools.flight.display import Display
        from gcs_tools.flight.run import fly_missions
        from gcs_tools.flight.run_folder import UsageError
        from gcs_tools.judging import result
        from gcs_tools.missions.mission import called, members

        published = speed is not None and controller is None
        try:
            again = CampaignFlights([each for name in missions for each in members(name)])
            results = fly_missions(
                again.missions, speed=speed, seed=seed, rate_hz=rate_hz, out=out, law=law, airframe=airframe,
                settings=settings, params=params, in_process=in_process, instance=instance, display=Display() if as_json else Terminal(),
                zenoh=arguments.publication(published if publish is None else publish, zenoh),
                jobs=jobs, figure=figure, record=record, controller=controller,
                controller_timeout_s=controller_timeout_s, overwrite=overwrite, allow_commands=allow_commands,
            )  # fmt: skip
        except UsageError as error:
            names = [called(each) for name in missions for each in members(name)]
            report_rejected(names, error, junit)
            raise Failure(error, USAGE) from error
        codes = [r.exit_code for r in results]
        if not (settings or params or law or airframe or controller) and (seed, rate_hz) == (
            None,
            None,
        ):
            codes = again.compared(results)
        code = max(codes, default=INTERRUPTED)
        if junit is not None:
            try:
                result.junit(results, junit)
            except result.ResultError as error:
                click.echo(f"Error: {error}", err=True)
                code = max(code, INFRASTRUCTURE)
        if as_json:
            print_json([dataclasses.asdict(r) for r in results])
    return code
