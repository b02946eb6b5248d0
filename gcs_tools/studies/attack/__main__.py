"""An attack on the guard from inside its beliefs: what it promises, against flights that try to break it.

python -m gcs_tools.studies.attack                        2000 flights under each policy that guards
python -m gcs_tools.studies.attack --flight 17            flight 17 of them again, and what happened
python -m gcs_tools.studies.attack --search 5000          an optimiser looks for the worst flight
python -m gcs_tools.studies.attack --computed             manoeuvres in the worst winds, which are computed
"""

from __future__ import annotations

import gc
import json
import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from gcs_tools.campaigns.flights import each
from gcs_tools.missions.mission import MissionError
from gcs_tools.studies.attack import computed as spines
from gcs_tools.studies.attack import history, report
from gcs_tools.studies.attack.draws import (
    NOISES,
    POLICIES,
    Attack,
    How,
    NoFlightError,
    Numbers,
    attack,
    parsed,
    sampled_attack,
)
from gcs_tools.studies.attack.flight import AttackFlown, fly
from gcs_tools.studies.attack.search import Search, search
from gcs_tools.studies.attack.verdict import DEFINITIONS, Verdict, verdict

COMMANDLINE = click.core.ParameterSource.COMMANDLINE
WIDTH, MOST = 120, 1000  # columns
DRAWN = "the study draws it; choose a --flight, or another --seed"
FIXED = {  # what a study says itself of a mission
    "flight.duration_s": "the study works it out from the setpoints that it draws",
    "flight.setpoints": DRAWN,
    "flight.curve": DRAWN,
    "flight.yaw": DRAWN,
    "flight.yaw_deg": DRAWN,
    "flight.arrive": "a flight of the study ends when its time is over",
    "law.guard": "expected --policy",
    "expect": "the study has a verdict of its own, see --help",
}


def flown(found: Attack) -> AttackFlown:
    """A drawn flight."""
    return fly(found.scene, found.gust, found.noise)


def campaign(how: How, flights: int, seed: int, console: Console | None = None) -> dict[int, Verdict]:  # fmt: skip
    """The verdict of each flight, by number, from 0."""

    def one(number: int) -> Verdict:
        found = sampled_attack(seed, number, how)
        return verdict(found, flown(found))

    first = one(0)  # compiles, on one thread
    gc.freeze()  # what is compiled is not looked through any more, at each of many small flights
    rest = each(one, range(1, flights), how.policy, console)
    return {0: first, **dict(enumerate(rest, start=1))}


def screen(*tables: Table) -> Console:
    """Standard output; where that is no terminal, as wide as the tables need, and `WIDTH` at least."""
    console = Console()
    if console.is_terminal:
        return console
    room = console.options.update(width=MOST)
    return Console(
        width=max(WIDTH, *(Measurement.get(console, room, t).maximum for t in tables), 0)
    )


def show(table: Table) -> None:
    """A table, whole."""
    screen(table).print(table)


def unused(given: set[str], settings: tuple[str, ...], noise: str, flight: str | None) -> str:
    """Why one of the options would change nothing; empty if each does.

    given : names of the parameters of `main` that are on the command line.
    """
    options = {"n": "--flights", "settings": "--set"}

    def told(name: str) -> str:
        return options.get(name, "--" + name.replace("_", "-"))

    written = [setting.partition("=")[0].strip() for setting in settings]
    if noise == "none" and (lost := given & {"part", "unknown"}):
        return f"{told(min(lost))}: there is no noise; add --noise bounded or --noise gaussian"
    if "manoeuvres" in given and "compute" not in given:
        return "--manoeuvre: expected with --computed"
    if "compute" in given and (
        lost := given & {"n", "seed", "noise", "as_shipped", "out", "field"}
    ):
        return f"{told(min(lost))}: the manoeuvres of --computed are not drawn; leave it out"
    if "n" in given and given & {"flight", "look"}:
        return "--flights: only a campaign has it; leave it out with --flight and with --search"
    if flight is not None and not flight.isdecimal():
        of_file = {"seed", "noise", "part", "unknown", "as_shipped", "settings", "field"}
        if lost := given & of_file:
            return f"{told(min(lost))}: {flight} says how it was flown; leave the option out"
    for key in written:
        for fixed, why in FIXED.items():
            if key == fixed or key.startswith(f"{fixed}."):
                return f"--set {key}: {why}"
    return ""


def attacked(policies: tuple[str, ...], how: How, flights: int, seed: int, as_json: bool) -> bool:
    """Fly and print a campaign under each policy; whether one contradicts the guard."""
    log = Console(stderr=True)
    found = {p: campaign(how._replace(policy=p), flights, seed, log) for p in policies}
    if as_json:
        content = {policy: report.content(of) for policy, of in found.items()}
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        for policy, of in found.items():
            show(report.table(policy, of))
            screen().print(report.limits_in_words(of), soft_wrap=True)
            if how.noise != "none" and not how.unknown:
                screen().print(report.noise_in_words(of), soft_wrap=True)
            show(report.worst_table(report.worst(of)))
    return any(map(report.contradicts, found.values()))


def searched(policies: tuple[str, ...], how: How, flights: int, seed: int, out: Path | None, as_json: bool) -> bool:  # fmt: skip
    """Search under each policy and print what was found; whether it contradicts the guard."""
    log, content, contradicts = Console(stderr=True), {}, False
    for policy in policies:
        this = how._replace(policy=policy)
        found = search(this, flights, seed, log)
        contradicts |= any(f.verdict.contradicts for f in found.found)
        content[policy] = _of_search(this, found)
        if not as_json:
            click.echo(f"{policy}: {found.flights} flights; the worst of each pair of setpoints and wind")  # fmt: skip
            show(report.worst_table({k: f.verdict for k, f in enumerate(found.found)}))
    if out is not None:
        out.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    return contradicts


def _of_search(how: How, found: Search) -> dict[str, Any]:
    settings = {".".join(path): value for path, value in how.settings.items()}
    return {
        "flights": found.flights,
        "how": {**how._asdict(), "settings": settings},
        "found": [
            {"verdict": report.plain(f.verdict._asdict()), "numbers": f.numbers._asdict()}
            for f in found.found
        ],
    }


def computed(policies: tuple[str, ...], how: How, names: tuple[str, ...], as_json: bool) -> bool:
    """Compute the worst winds of each manoeuvre under each policy and print them. Returns True if one contradicts."""
    log, content, contradicts = Console(stderr=True), {}, False
    for policy in policies:
        found = spines.spine(how._replace(policy=policy), names, log)
        contradicts |= spines.contradicts(found)
        content[policy] = spines.content(found)
        if not as_json:
            show(spines.table(policy, found))
    if as_json:
        click.echo(json.dumps(content, indent=2))
    return contradicts


def chosen(flight: str, policy: str, how: How, seed: int) -> Attack:
    """A flight by its number, or FILE:RANK of what a search has written. Raises ClickException."""
    if flight.isdecimal():
        return sampled_attack(seed, int(flight), how._replace(policy=policy))
    name, _, rank = flight.rpartition(":")
    name, rank = (name, rank) if name and rank.isdecimal() else (flight, "0")
    try:
        of = json.loads(Path(name).read_text())[policy]
        numbers, told = Numbers(**of["found"][int(rank)]["numbers"]), dict(of["how"])
        told["settings"] = {tuple(k.split(".")): v for k, v in told["settings"].items()}
        found = attack(numbers, How(**told))
    except OSError as error:
        raise click.UsageError(f"--flight {flight}: expected a number or a file of --search ({error.strerror})") from error  # fmt: skip
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise click.UsageError(f"--flight {flight}: no flight of {policy} that a search has written") from error  # fmt: skip
    if found is None:
        raise click.UsageError(f"--flight {flight}: its gains are not stable any more")
    return found


def shown(policies: tuple[str, ...], how: How, flight: str, seed: int, out: Path | None, as_json: bool) -> bool:  # fmt: skip
    """Fly one flight again under each policy and print what happened; whether it contradicts."""
    content, contradicts, console = {}, False, screen()
    for policy in policies:
        found = chosen(flight, policy, how, seed)
        rows = flown(found)
        said, met, over = verdict(found, rows), history.events(found, rows), history.seconds(found, rows)  # fmt: skip
        contradicts |= said.contradicts
        if out is not None:
            path = out if len(policies) == 1 else out.with_stem(f"{out.stem}_{policy}")
            history.write(found, rows, path)
        content[policy] = {
            "flight": history.described(found),
            "verdict": report.plain(said._asdict()),
            "events": [event._asdict() for event in met],
            "seconds": [report.plain(second._asdict()) for second in over],
        }
        if not as_json:
            described = {k: v for k, v in history.described(found).items() if k != "numbers"}
            described["sent"] = [[round(x, 3) for x in row] for row in described["sent"][:10]]
            console.print(policy, described)
            for table in (
                report.worst_table({flight: said}),
                history.event_table(met),
                history.second_table(over),
            ):
                show(table)
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
    return contradicts


@click.command(epilog="\b" + DEFINITIONS)
@click.option("--policy", "policies", multiple=True, type=click.Choice([*POLICIES, "warn"]), help="of the guard (default: govern and refuse; warn: unguarded, which shows that the attack can win)")  # fmt: skip
@click.option("--flights", "n", default=2000, show_default=True, type=click.IntRange(1), help="how many are drawn")  # fmt: skip
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of what is drawn, or of the search")  # fmt: skip
@click.option("--noise", type=click.Choice(NOISES), default="none", show_default=True, help="of the reported state: white, within the amounts of noisy_state, or of that sigma")  # fmt: skip
@click.option("--part", default=1.0, show_default=True, type=click.FloatRange(0.0, min_open=True), help="of those amounts")  # fmt: skip
@click.option("--unknown", is_flag=True, help="the guard believes in no noise")
@click.option("--as-shipped", is_flag=True, help="the law with its defaults: draw plant, wind and setpoints alone")  # fmt: skip
@click.option("--set", "settings", multiple=True, metavar="TABLE.KEY=VALUE", help="a value of a mission, over what is drawn")  # fmt: skip
@click.option("--field", type=click.Path(exists=True, file_okay=False), help="a packed field of up to 1 m/s is the wind, scaled to what is believed (attack.eddies makes one)")  # fmt: skip
@click.option("--flight", metavar="NUMBER|FILE[:RANK]", help="fly one again: of the seed, or of a search's --out")  # fmt: skip
@click.option("--search", "look", type=click.IntRange(128), metavar="N", help="an optimiser looks for the worst within N flights")  # fmt: skip
@click.option("--computed", "compute", is_flag=True, help="a few manoeuvres, each in the worst wind for each limit, which is computed")  # fmt: skip
@click.option("--manoeuvre", "manoeuvres", multiple=True, type=click.Choice([*spines.MANOEUVRES]), help="with --computed: these (default: all)")  # fmt: skip
@click.option("--out", type=click.Path(dir_okay=False, writable=True, path_type=Path), help="of --flight every tick as CSV, of --search what it found as JSON")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="a JSON object on standard output")
def main(
    policies: tuple[str, ...], n: int, seed: int, noise: str, part: float, unknown: bool, as_shipped: bool,
    settings: tuple[str, ...], field: str | None, flight: str | None, look: int | None,
    compute: bool, manoeuvres: tuple[str, ...], out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Attack the guard from inside its beliefs; exit 1 if a flight contradicts it."""
    if flight is not None and look is not None:
        raise click.UsageError("--flight and --search: expected one of them")
    if out is not None and flight is None and look is None:
        raise click.UsageError("--out: expected with --flight or --search")
    if out is not None and not out.parent.is_dir():
        raise click.UsageError(f"--out {out}: there is no folder {out.parent}")
    if compute and (flight is not None or look is not None):
        raise click.UsageError("--computed: expected without --flight and without --search")
    source = click.get_current_context().get_parameter_source
    given = {name for name in click.get_current_context().params if source(name) is COMMANDLINE}
    if why := unused(given, settings, noise, flight):
        raise click.UsageError(why)
    policies = policies or POLICIES
    try:
        how = How(
            noise=noise,
            part=part,
            unknown=unknown,
            as_shipped=as_shipped,
            settings=parsed(settings),
            field=field or "",
        )
        if flight is not None:
            contradicts = shown(policies, how, flight, seed, out, as_json)
        elif look is not None:
            contradicts = searched(policies, how, look, seed, out, as_json)
        elif compute:
            contradicts = computed(policies, how, manoeuvres or tuple(spines.MANOEUVRES), as_json)
        else:
            contradicts = attacked(policies, how, n, seed, as_json)
    except (MissionError, NoFlightError) as error:
        raise click.UsageError(str(error)) from error
    sys.exit(1 if contradicts else 0)


if __name__ == "__main__":
    main()
