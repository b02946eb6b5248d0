"""The guarantees of fcu.theory against simulation.

python -m gcs_tools.studies.theory_check                  1000 random systems a bound, the octocopter's loops
python -m gcs_tools.studies.theory_check --systems 100    fewer
"""

from __future__ import annotations

import json
import sys

import click
from rich.console import Console
from rich.progress import Progress

from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load
from gcs_tools.studies.theory_check import check, octocopter, report

GAMMAS, MASSES = (1e3, 3e3, 1e4, 1e5), (8.0, 9.0, 10.0)
MEDIAN = 20.0  # bound over measured, the most for the octocopter's loops


@click.command()
@click.option("--systems", type=click.IntRange(1), default=1000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--steps", type=click.IntRange(100), default=check.STEPS, show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The result as JSON.")
def main(systems: int, seed: int, steps: int, as_json: bool) -> None:
    """Hold simulated errors against their bounds; 1 if one is exceeded, or one is too loose."""
    findings = report.Findings()
    params = scenario(load("paper_nominal")).law  # Section VIII
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("random systems", total=None)
        for found in check.random_systems(seed, systems, steps=steps):
            findings.add("random", found)
            progress.advance(task)
        task = progress.add_task("octocopter", total=len(GAMMAS) * (len(MASSES) + 2))
        for found in octocopter.octocopter_loops(params, GAMMAS, MASSES, duration=10.0):
            findings.add("octocopter", found)
            progress.advance(task)
    lines = findings.lines()
    if as_json:
        click.echo(json.dumps(report.content(lines), indent=2, allow_nan=False))
    else:
        Console().print(report.table(lines))
    loose = [
        line for line in lines if line.part == "octocopter" and line.tightness["median"] > MEDIAN
    ]
    sys.exit(1 if findings.exceeded or loose else 0)


if __name__ == "__main__":
    main()
