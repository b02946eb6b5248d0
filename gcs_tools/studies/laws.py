"""The table and the figure of docs/laws.md: every law, tuned alike, on two airframes, in ten missions.

    python -m gcs_tools.studies.laws                 all shipped laws, s1000 and quad, 300 seeds
    python -m gcs_tools.studies.laws mmrac px4 --seeds 20 --untuned

Tunes what has no file of gains in docs/laws yet, compares, and writes the part of docs/laws.md between
its two marks, of all variants that were compared, and docs/figures/laws.png; results.json and results.parquet
go to --out.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

BEGIN, END = "<!-- the table: begin -->", "<!-- the table: end -->"
LAWS = ("mmrac", "px4", "se3", "indi", "l1", "l1:unmatched=tilted")
AIRFRAMES = ("s1000", "quad")
SEEDS = 300
# Neither is part of a law, so each is flown with both and without.
VARIANTS = {
    "with": ("lag inversion and safe allocation", ()),
    "without": ("neither", ("law.rotor_response_s=1.0", "law.allocation=plain")),
}


def gcs(*arguments: Any) -> None:
    """Run a command line of gcs. Raises CalledProcessError."""
    subprocess.run([sys.executable, "-m", "gcs_tools", *map(str, arguments)], check=True)


def tuned(
    laws: Sequence[str], airframes: Sequence[str], folder: Path, settings: Sequence[str]
) -> None:
    """Tune what has no file of gains of these sources and this procedure yet."""
    from gcs_tools.campaigns import gains_file, procedure
    from gcs_tools.campaigns.entrant import entrant

    followed = procedure.read().sha256
    folder.mkdir(parents=True, exist_ok=True)
    files = [gains_file.read(path) for path in folder.glob("*.toml")]
    for airframe in airframes:
        for law in laws:
            made = entrant(law, airframe, settings=tuple(settings))
            known = gains_file.of(files, law, made.airframe)
            if (
                known is None
                or known.provenance.get("procedure_sha256") != followed
                or gains_file.changes(known, made)
            ):
                out = folder / f"{gains_file.name(made)}.toml"
                sets = (f"--set={each}" for each in settings)
                gcs("tune", law, "--airframe", airframe, "--out", out, *sets)


def table(found: dict[str, Any], airframe: str) -> list[str]:
    """Markdown: missions by laws, the mean error in mm with its interval; what all missions say."""
    laws = [each["law"] for each in found["laws"] if each["airframe"] == airframe]
    missions = [each["mission"] for each in found["missions"]]
    cells = {(c["mission"], c["law"]): c for c in found["cells"] if c["airframe"] == airframe}
    overall = {each["law"]: each for each in found["overall"] if each["airframe"] == airframe}
    lines = [_heading(f"{airframe}: error, mm", laws), "|---" * (len(laws) + 1) + "|"]
    for mission in missions:
        lines.append(_heading(_said(mission), [_error(cells[mission, law]) for law in laws]))
    for said, of in (
        ("cost, by the procedure", lambda each: _interval(each["cost"], 1.0, ".2f")),
        ("lost, %", lambda each: _interval(each["lost"], 100.0, ".2f")),
        ("ticks saturated, %", lambda each: _interval(each["means"]["saturated"], 100.0, ".2f")),
        ("greatest tilt, % of limit", lambda each: _interval(each["means"]["tilt"], 100.0, ".0f")),
        ("greatest thrust, % of limit", lambda each: _interval(each["means"]["thrust"], 100.0, ".0f")),
        ("energy, kJ", lambda each: _interval(each["means"]["energy_j"], 1e-3, ".1f")),
        ("rotor command noise, % per tick", lambda each: _interval(each["means"]["noise"], 100.0, ".2f")),
    ):  # fmt: skip
        lines.append(_heading(said, [of(overall[law]) for law in laws]))
    for quantity in dict.fromkeys(each["quantity"] for each in found["margins"]):
        of_laws = {
            each["law"]: each
            for each in found["margins"]
            if (each["airframe"], each["quantity"]) == (airframe, quantity)
        }
        unit = next(iter(of_laws.values()))["unit"]
        said = f"not lost up to {quantity}, {unit}"
        lines.append(_heading(said, [_held(of_laws[law]) for law in laws]))
    lines += ["", _heading(f"{airframe}: error of the whole flight, m", laws), "|---" * (len(laws) + 1) + "|"]  # fmt: skip
    for mission in missions:
        whole = [_interval(cells[mission, law]["means"]["error_all_m"], 1.0, ".3g") for law in laws]
        lines.append(_heading(_said(mission), whole))
    return [*lines, ""]


def _heading(first: str, others: Sequence[str]) -> str:
    return f"| {first} | " + " | ".join(others) + " |"


def _said(mission: str) -> str:
    return mission.replace("_", " ")


def differences(found: dict[str, Any], airframe: str) -> list[str]:
    """Markdown: error and cost less those of the first law, over common seeds."""
    of = [each for each in found["differences"] if each["airframe"] == airframe]
    if not of:
        return []
    laws = list(dict.fromkeys(each["law"] for each in of))
    by = {(each["mission"], each["law"]): each for each in of}
    missions, seeds = dict.fromkeys(each["mission"] for each in of), len(found["seeds"])
    rule = "|---" * (len(laws) + 1) + "|"
    lines = [_heading(f"{airframe}: error minus {of[0]['first']}'s, mm", laws), rule]
    for mission in missions:
        row = [_common(by[mission, law], seeds) for law in laws]
        lines.append(_heading(_said(mission), row))
    lines += ["", _heading(f"{airframe}: cost minus {of[0]['first']}'s", laws), rule]
    for mission in missions:
        row = [_interval(by[mission, law]["cost"], 1.0, "+.2f") for law in laws]
        lines.append(_heading(_said(mission), row))
    overall = {each["law"]: each for each in found["overall"] if each["airframe"] == airframe}
    row = [_interval(overall[law]["cost_less_first"], 1.0, "+.3f") for law in laws]
    lines.append(_heading("all missions", row))
    return [*lines, ""]


def _common(difference: dict[str, Any], seeds: int) -> str:
    """The difference of error, and of how many seeds, if not of all."""
    told = _interval(difference["error_m"], 1e3, "+.3g")
    return told if difference["pairs"] == seeds else f"{told} of {difference['pairs']} seeds"


def _error(cell: dict[str, Any]) -> str:
    lost = f"{cell['lost']} of {cell['flights']} lost" if cell["lost"] else ""
    error = (
        "" if cell["lost"] == cell["flights"] else _interval(cell["means"]["error_m"], 1e3, ".3g")
    )
    return ", ".join(part for part in (error, lost) if part)


def _interval(interval: dict[str, float | None], factor: float, form: str) -> str:
    value, low, high = (interval[name] for name in ("value", "low", "high"))
    if value is None:
        return "-"
    if low is None or high is None:
        return f"{factor * value:{form}}"
    return f"{factor * value:{form}} [{factor * low:{form}}, {factor * high:{form}}]"


def _held(margin: dict[str, Any]) -> str:
    if margin["held"] is None:
        return "always lost"
    return f"{margin['held']:.3g}" + ("" if margin["lost"] is not None else " or more")


def page(found: dict[str, dict[str, Any]]) -> str:
    """What stands between the marks; `found`: results of each variant."""
    lines: list[str] = []
    for variant, results in found.items():
        airframes = dict.fromkeys(each["airframe"] for each in results["laws"])
        lines += [f"### With {variant}", "", f"{len(results['seeds'])} seeds, procedure {results['procedure_sha256'][:16]}.", ""]  # fmt: skip
        for airframe in airframes:
            lines += table(results, airframe)
        for airframe in airframes:
            lines += differences(results, airframe)
    return "\n".join(lines)


@click.command()
@click.argument("laws", nargs=-1)
@click.option("--airframe", "airframes", multiple=True, help="Default: s1000 and quad.")
@click.option("--seeds", type=click.IntRange(1), default=SEEDS, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs/laws"), show_default=True
)
@click.option(
    "--variant", "variants", type=click.Choice([*VARIANTS]), multiple=True, help="Default: both."
)
@click.option("--untuned", is_flag=True, help="Fly the defaults; nothing is tuned.")
@click.option("--docs", type=click.Path(path_type=Path), default=Path("docs"), show_default=True)
def main(
    laws: tuple[str, ...], airframes: tuple[str, ...], seeds: int, out: Path, variants: tuple[str, ...],
    untuned: bool, docs: Path,
) -> None:  # fmt: skip
    """Tune, compare and write docs/laws.md's table and figure."""
    laws, airframes = laws or LAWS, airframes or AIRFRAMES
    figure, path = docs / "figures" / "laws.png", docs / "laws.md"
    for variant in variants or VARIANTS:
        _, settings = VARIANTS[variant]
        folder, results = docs / "laws" / variant, out / variant
        if not untuned:
            tuned(laws, airframes, folder, settings)
        gcs(
            "compare", *laws, "--missions", "benchmark", "--seeds", seeds, "--margins", "--out", results,
            *(part for airframe in airframes for part in ("--airframe", airframe)),
            *(part for setting in settings for part in ("--set", setting)),
            *(() if untuned else ("--gains", folder)),
        )  # fmt: skip
        if variant == "with":
            figure.write_bytes((results / "results.png").read_bytes())
        there = {each: out / each / "results.json" for each in VARIANTS}
        found = {
            VARIANTS[each][0]: json.loads(file.read_text())
            for each, file in there.items()
            if file.exists()
        }
        before, _, rest = path.read_text().partition(BEGIN)
        after = rest.partition(END)[2]
        path.write_text(f"{before}{BEGIN}\n\n{page(found)}\n{END}{after}")
    click.echo(f"{path}\n{figure}")


if __name__ == "__main__":
    main()
