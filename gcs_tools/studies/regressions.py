"""`python -m gcs_tools.studies.regressions`: which small changes `gcs compare --fail` and `--exact` see.

Flies a mission with noise on seeds 1 to 20 as the baseline. Each change is then flown on the same seeds,
and on others. Unchanged flights on yet other seeds tell how often an alarm is false.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

import gcs_tools
from gcs_tools.campaigns.regression import Held, held_against
from gcs_tools.judging.comparison import all_flown, below

MISSION = "noisy_state"
BASELINE, OTHERS = range(1, 21), range(101, 106)
CHANGES = (
    "law.f_m=2.04", "law.f_m=1.96", "law.zeta_m=0.816", "law.c_angle=[7.14,7.14,3.06]",
    "law.c_angle=[6.86,6.86,2.94]", "law.c_rate=[14.28,14.28,6.12]", "law.c_rate=[13.72,13.72,5.88]",
    "law.gamma=2040", "law.gamma=1960", "law.sigma_v=0.714", "law.m_hat_0=8.16", "law.trim_rate=3.06",
    "plant.rotor_loss=[{rotor=1,at_s=8.0,effectiveness=0.95}]", "plant.delay_s=0.002",
    "plant.mass_kg=8.16", "plant.rotor_lag_s=0.051", "plant.drag=[0.153,0.153,0.153]",
    "wind.amplitude_m_s=[7.344,7.344,5.814]", "wind.rotation_amplitude_rad_s=[0.714,0.612,0.51]",
    "plant.noise.position_m=0.0102",
)  # fmt: skip


def flown(out: Path, seeds: Sequence[int], settings: Sequence[str] = ()) -> Path:
    """The folder of flights with these seeds."""
    for seed in seeds:
        gcs_tools.fly(
            MISSION, settings=list(settings), in_process=True, seed=seed, out=out / str(seed),
            figure="never", record="none",
        )  # fmt: skip
    return out


def held(run: Path, baseline: Path, exact: bool = False) -> Held:
    """The judgement of `gcs compare` on them."""
    return held_against(all_flown(below(run)), all_flown(below(baseline)), exact)[0]


@click.command(help=__doc__)
@click.option("--unchanged", default=200, help="Flights without a change, on seeds of their own.")
def main(unchanged: int) -> None:
    """Fly, and print a line for each change and one for all that is unchanged."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        baseline = flown(folder / "baseline", BASELINE)
        print(f"{'change':60s} exact  same seed  20 seeds  5 other seeds")
        for i, change in enumerate(CHANGES):
            same = flown(folder / f"same{i}", BASELINE, [change])
            other = flown(folder / f"other{i}", OTHERS, [change])
            seen = [
                not held(same, baseline, exact=True).passed,
                not held(same / "1", baseline).passed,
                not held(same, baseline).passed,
                not held(other, baseline).passed,
            ]
            print(
                f"{change:60s} {'  '.join('seen  ' if each else '-     ' for each in seen)}",
                flush=True,
            )
        alarms = {}
        for seed in range(1001, 1001 + unchanged):
            found = held(flown(folder / f"{seed}", [seed]), baseline)
            if not found.passed:
                alarms[seed] = found.lines()
        print(f"unchanged, other seeds: {len(alarms)} of {unchanged} are told to be worse")
        for seed, lines in alarms.items():
            print(f"  seed {seed}: {lines}")


if __name__ == "__main__":
    main()
