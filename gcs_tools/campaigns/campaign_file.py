"""A campaign: a TOML file read and checked, and the missions that its flights are drawn from.

    campaign = read("paper_noise", Changes(flights=100))

What is wrong with a file is said with its line, its key and what was expected there.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from fcu.interface.airframe import AirframeError
from fcu.interface.files import input_file, toml_file
from fcu.interface.files.input_file import MIB
from fcu.interface.files.spelling import suggestion, suggestion_or_list
from fcu.interface.files.toml_file import FileError
from fcu.interface.parameter import ParameterError
from gcs_tools.campaigns.batch import VEHICLE
from gcs_tools.campaigns.distributions import Distribution
from gcs_tools.campaigns.draws import (
    GRID,
    LIST,
    METHODS,
    MOST_DIMENSIONS,
    RANDOM,
    SEED,
    DrawError,
    Draws,
    check_apart,
    grid_size,
    key,
)
from gcs_tools.campaigns.looks import Looks
from gcs_tools.campaigns.procedure import Draws as SeedRanges
from gcs_tools.campaigns.rare import Mixture
from gcs_tools.campaigns.seed_draws import SeedDraws
from gcs_tools.flight.law_alone import PASSED_ON
from gcs_tools.flight.scenario import refuse_faults_of_autopilot, refuse_link_faults, scenario
from gcs_tools.judging.metrics import FLOORS, METRICS
from gcs_tools.judging.preflight_check import refused_gains
from gcs_tools.missions import mission as mission_file
from gcs_tools.missions import problems
from gcs_tools.missions.fields import Positive, Table, because, one_line, optional, wrong
from gcs_tools.missions.mission import (
    Mission,
    MissionError,
    allowed,
    from_tables,
    once,
    parsed_setting,
    with_airframe,
    with_law,
    with_values,
)

FOLDER = "campaigns"  # of the shipped ones, among the missions
MOST_BYTES = MIB
MOST_FLIGHTS = 1_000_000
MOST_LAWS = 20
LAW = "law"
FLOWN = (VEHICLE, LAW)
NO_IDENTITY = {"title", "expect", "metrics", "map"}  # keys that change no flight
TELLING = "setpoint_error_rms_settled_m"  # what flights are ranked by, if a file does not say


def _metric(name: str) -> str:
    if name not in METRICS:
        raise wrong((), f"a metric{suggestion(name, METRICS)}", name)
    return name


_Metric = Annotated[str, AfterValidator(_metric)]
_Share = Annotated[float, Field(gt=0.0, lt=1.0)]
_Confidence = Annotated[float, Field(ge=0.5, le=0.9999)]


class CampaignError(input_file.PlainError):
    """A campaign that cannot be flown: file, line, key and what was expected."""

    KEPT = "\n"


class Stop(Table):
    """When a campaign may end before all flights are flown."""

    width: _Share = Field(description="the interval of success of every law is no wider than this")


class ExpectedShare(Table):
    """What the share of successful flights is held against: a bound of its interval."""

    at_least: Annotated[float, Field(ge=0.0, le=1.0)]
    confidence: _Confidence = 0.95


class Expected(Table):
    """What the campaign's exit code is by."""

    success: ExpectedShare


class Rare(Table):
    """Rare failures: cross-entropy over the drawn quantities; a flight fails when a metric is beyond."""

    metric: _Metric
    limit: float | None = optional("a flight fails with more")
    at_least: float | None = optional("a flight fails with less")
    stage: Annotated[int, Field(ge=50, le=100_000)] = Field(
        200, description="flights of each stage that looks for where failures are"
    )
    stages: Annotated[int, Field(ge=1, le=50)] = Field(10, description="such stages at most")

    @model_validator(mode="after")
    def _one_limit(self) -> Self:
        if (self.limit is None) == (self.at_least is None):
            raise wrong((), "either limit or at_least")
        return self


class Seeds(SeedRanges):
    """Flights drawn from seeds, as `gcs tune` and `gcs compare` draw them: vehicle, wind and noise."""

    far_m: Positive = Field(description="a flight that ends farther from its setpoint is lost")


class LawEntry(Table):
    """A law with settings of its own."""

    law: str
    label: Annotated[str, Field(pattern=r"^[\w.+-][\w .+:=,\[\]-]{0,79}$")] | None = optional(
        "its name in results: letters, digits, spaces and . + - _ : = , [ ]; left out: the law's"
    )
    set: dict[str, Any] = Field({}, description="dotted key of a mission -> value")


class Map(Table):
    """Success over two drawn quantities, drawn as a map."""

    over: Annotated[tuple[str, str], Field(strict=False)] = Field(
        description="drawn quantities: across, and up"
    )
    up_to: str | None = optional(
        "a drawn number: shown is up to which of its values all flights succeed; left out: the share that succeeds"
    )
    panels: str | None = optional(
        "a drawn quantity: a panel for each of its values, and one for all"
    )
    labels: dict[str, str] = Field({}, description="what axes call a quantity")


class Document(Table):
    """A campaign: one mission flown many times with its uncertain values sampled."""

    title: Annotated[str, AfterValidator(one_line)]
    mission: str = Field(description="a shipped one's name, or a file (relative to this one)")
    airframe: str | None = optional("in place of the mission's own; a name, or a file")
    laws: (
        Annotated[
            tuple[str | LawEntry, ...], Field(strict=False, min_length=1, max_length=MOST_LAWS)
        ]
        | None
    ) = optional("names, FILE.py, or { law, label, set }; left out: the mission's own")
    set: dict[str, Any] = Field({}, description="dotted key of a mission -> value, of all flights")
    flights: Annotated[int, Field(ge=1)] | None = optional("how many, of each law")
    seed: Annotated[int, Field(ge=0, lt=2**53)] = 1
    method: Literal[METHODS] = RANDOM  # type: ignore[valid-type]
    fly: Literal[FLOWN] = Field(  # type: ignore[valid-type]
        VEHICLE, description="the whole vehicle, or the law alone without an autopilot: faster"
    )
    draw: dict[str, Distribution] = Field({}, description="dotted key of a mission -> distribution")
    points: Annotated[tuple[dict[str, Any], ...], Field(strict=False)] = Field(
        (), description='with method = "list": the values of each flight'
    )
    success: dict[str, Any] | None = optional("in place of the mission's [expect]")
    metrics: Annotated[tuple[_Metric, ...], Field(strict=False, min_length=1)] | None = optional(
        "shown, and ranked by the first"
    )
    confidence: _Confidence = Field(0.95, description="of all intervals")
    stop: Stop | None = optional("end early")
    expect: Expected | None = optional("exit with 1 unless this is shown")
    map: Map | None = optional("draw success over two drawn quantities")
    rare: Rare | None = optional("estimate the probability of a rare failure")
    seeds: Seeds | None = optional("draw as laws are compared: flight n has the seed `seed` + n")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.method == LIST) != bool(self.points):
            raise wrong(("points",), 'points with method = "list", and with no other')
        if self.points and self.draw:
            raise wrong(("draw",), "no [draw] beside points")
        if len(self.draw) > MOST_DIMENSIONS:
            raise wrong(("draw",), f"{MOST_DIMENSIONS} quantities at most")
        if self.method == GRID:
            for name, each in self.draw.items():
                if not each.is_choice and each.levels is None:
                    raise wrong(("draw", name), "choice or levels, in a grid")
            if not self.draw:
                raise wrong(("draw",), "quantities for the grid")
        cells = self._cells
        if cells is None and self.flights is None:
            raise wrong(("flights",), "how many flights")
        if cells and (self.flights or cells) % cells:
            raise wrong(("flights",), f"a multiple of the {cells} points", self.flights)
        if (n := self.n) > MOST_FLIGHTS:
            raise wrong(
                ("flights",), f"at most {MOST_FLIGHTS:,} (for rare failures there is [rare])", n
            )
        if self.stop is not None and cells:
            raise wrong(
                ("stop",), "no early end of a grid or a list, whose flights are in an order"
            )
        if self.expect is not None and cells:
            raise wrong(
                ("expect",), "nothing of a grid or a list, which are no sample of what is not known"
            )
        if self.rare is not None and (self.method != RANDOM or not self.draw):
            raise wrong(("rare",), f'[draw], and method = "{RANDOM}"')
        if self.rare is not None and (self.flights or 0) < 2:
            raise wrong(("flights",), "2 or more beside [rare], for an interval", self.flights)
        if self.rare is not None and (self.stop or self.expect or self.success is not None):
            raise wrong(("rare",), "neither stop, expect nor success beside [rare]")
        if self.rare is not None and len(self.laws or ()) > 1:
            raise wrong(("laws",), "one law with [rare]")
        if self.seeds is not None:
            self._check_seeds()
        if self.map is not None:
            self._check_map(self.map)
        if twice := [name for name, n in Counter(self.metrics or ()).items() if n > 1]:
            raise because(("metrics",), f"{twice[0]} is there twice")
        return self

    def _check_map(self, of: Map) -> None:
        if self.rare is not None or self.seeds is not None:
            raise wrong(("map",), "no map beside [rare] or [seeds]")
        points = {name: [point[name] for point in self.points if name in point] for point in self.points for name in point}  # fmt: skip
        drawn = {**points, **{name: list(each.choice or ()) for name, each in self.draw.items()}}
        named = (*of.over, of.up_to, of.panels)
        for key_, name in zip(("over", "over", "up_to", "panels"), named, strict=True):
            if name is not None and name not in drawn:
                raise wrong(("map", key_), f"drawn quantities: {', '.join(drawn)}", name)
        for name in of.labels:
            if name not in drawn:
                why = f"not drawn{suggestion_or_list(name, drawn)}"
                raise because(("map", "labels", name), why)
        if len(set(filter(None, named))) < len(list(filter(None, named))):
            raise wrong(("map",), "quantities that differ")
        if of.up_to is not None and any(isinstance(v, str | bool | list) for v in drawn[of.up_to]):
            raise wrong(("map", "up_to"), "a quantity whose values are numbers", of.up_to)
        if of.panels is not None and not drawn[of.panels]:
            raise wrong(("map", "panels"), "a quantity drawn with choice", of.panels)

    def _check_seeds(self) -> None:
        if self.draw or self.method != RANDOM or self.rare is not None:
            raise wrong(("seeds",), "neither [draw], method nor [rare] beside [seeds]")
        if self.success is not None:
            raise wrong(
                ("seeds",), "no [success] beside [seeds]: a flight that is not lost succeeds"
            )
        if self.fly != LAW:
            raise wrong(("seeds",), 'fly = "law" beside [seeds]')
        for entry in self.laws or ():
            for name in entry.set if isinstance(entry, LawEntry) else ():
                if not name.startswith("law."):
                    raise wrong(
                        ("laws",),
                        "keys of [law] alone beside [seeds], which draws alike for all",
                        name,
                    )

    @property
    def _cells(self) -> int | None:
        if self.method == GRID:
            return grid_size(list(self.draw.values()))
        return len(self.points) if self.method == LIST else None

    @property
    def n(self) -> int:
        """How many flights there are of each law."""
        looking = 0 if self.rare is None else self.rare.stage * self.rare.stages
        return looking + (self.flights or self._cells or 0)


@dataclass(frozen=True)
class Changes:
    """Changes that a command line makes to a campaign's file. None, or empty: no change."""

    flights: int | None = None  # of each law
    seed: int | None = None
    set: Mapping[str, Any] = field(default_factory=dict)  # dotted key of a mission -> value
    metrics: tuple[str, ...] = ()  # shown, and ranked by the first

    def plain(self) -> dict[str, Any]:
        """As a campaign's folder keeps it."""
        return asdict(self)

    def of_document(self) -> dict[str, Any]:
        """The keys of the file that it replaces."""
        found: dict[str, Any] = {"flights": self.flights, "seed": self.seed}
        if self.metrics:
            found["metrics"] = list(self.metrics)
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True)
class Variant:
    """A law as a campaign flies it: its mission before anything is drawn."""

    label: str
    mission: Mission
    base: Mapping[str, Any]  # the mission's values by key
    folder: Path | None = None  # where its script runs; None: it has none
    beside: Path = Path()  # the folder of the mission's file, absolute

    def told(self) -> dict[str, Any]:
        """The part of it that workers get."""
        mission = self.mission
        plain = {
            "label": self.label, "given": mission.given, "law": mission.flown.digest,
            "airframe": mission.airframe.sha256,
        }  # fmt: skip
        return plain if self.folder is None else {**plain, "folder": str(self.folder)}


@dataclass(frozen=True)
class Campaign:
    """A campaign that may be flown."""

    name: str
    source: str  # its file, as messages name it
    text: str
    document: Document
    draws: Draws
    variants: tuple[Variant, ...]
    changes: Changes = Changes()
    in_all: int | None = None  # flights of each law that are flown with these. None: no others

    @property
    def n(self) -> int:
        """Flights of each law."""
        return self.draws.n

    @property
    def labels(self) -> tuple[str, ...]:
        """The laws, as results name them."""
        return tuple(variant.label for variant in self.variants)

    @property
    def looks(self) -> Looks:
        """At how many flights it is looked at, and may end."""
        stop = self.document.stop
        return Looks.of(self.n, self.document.confidence, None if stop is None else stop.width)

    @property
    def ranked_by(self) -> str:
        """The metric that flights are ranked by."""
        if self.document.rare is not None:
            return self.document.rare.metric
        metrics = self.document.metrics
        return metrics[0] if metrics else TELLING

    @property
    def floors(self) -> bool:
        """Whether little of that metric is bad."""
        rare = self.document.rare
        return self.ranked_by in FLOORS if rare is None else rare.at_least is not None

    def plan(self) -> str:
        """What workers need, and all that rows depend on but the draws, as JSON."""
        return self._plan(self.in_all or self.n)

    def _plan(self, flights: int) -> str:
        plan = {
            "name": self.variants[0].mission.name,
            "fly": self.document.fly,
            "flights": flights,
            "laws": [each.told() for each in self.variants],
        }
        if self.document.seeds is not None:
            plan["far_m"] = self.document.seeds.far_m
        return json.dumps(plan, sort_keys=True)

    @property
    def identity(self) -> str:
        """A hash of everything that rows and early end depend on."""
        left_out = NO_IDENTITY | ({"seeds"} if self.document.seeds is None else set())
        document = self.document.model_dump(mode="json", exclude=left_out)
        text = json.dumps([document, self.n, self._plan(self.n)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


# --- reading


def shipped() -> list[str]:
    """Names of the shipped campaigns."""
    return [path.stem for path in sorted((mission_file.folder() / FOLDER).glob("*.toml"))]


def path_of(name: str) -> Path:
    """The file of a campaign's name, or the file that is named. Raises CampaignError."""
    ours = mission_file.folder() / FOLDER / f"{name.removeprefix(f'{FOLDER}/')}.toml"
    if isfile(ours) and not isfile(name):
        return ours
    if isdir(name):
        raise CampaignError(
            f"{name}: a folder without a campaign (it has no campaign.json): expected a campaign's"
            " file, or the folder of a campaign that was interrupted"
        )
    if name.endswith(".toml") or exists(name):
        return Path(name)
    if name in mission_file.shipped():
        raise CampaignError(
            f'{name} is a mission: a campaign is a file that names it (mission = "{name}"), as'
            " gcs campaign --help shows"
        )
    meant = suggestion(name, shipped())
    raise CampaignError(
        f"{input_file.plain(name)}: no such campaign{meant}; there are {', '.join(shipped())}"
    )


def settings(written: Sequence[str]) -> dict[str, Any]:
    """Dotted key of a mission -> value, of TABLE.KEY=VALUE each. Raises CampaignError."""
    try:
        return {key: value for key, value, _ in map(parsed_setting, once(written))}
    except MissionError as error:
        raise CampaignError(str(error)) from error


def read(
    name: str | Path, changes: Changes = Changes(), allow_commands: bool = False
) -> Campaign:  # fmt: skip
    """A shipped campaign by its name, or any by its file, with what the command line changes.

    allow_commands : its mission may name a command ([flight] script), which workers run.
    Raises CampaignError.
    """
    path = path_of(str(name))
    try:
        text = toml_file.text_of(path, MOST_BYTES)
    except FileError as error:
        raise CampaignError(str(error)) from error
    return parsed(text, str(path), path.parent, path.stem, changes, allow_commands)


def parsed(
    text: str, source: str, folder: Path, name: str, changes: Changes = Changes(),
    allow_commands: bool = False,
) -> Campaign:  # fmt: skip
    """The campaign of a text. `folder`: where relative names in it begin. Raises CampaignError."""
    try:
        file = toml_file.parsed(text, source)
    except FileError as error:
        raise CampaignError(str(error)) from error
    given, where = file.tables, file.where
    if isinstance(given.get("draw"), dict):
        drawn = list(_flat(given["draw"]))
        given["draw"] = dict(drawn)
        for quantity, n in Counter(quantity for quantity, _ in drawn).items():
            if n > 1:
                raise CampaignError(f"{where('draw', quantity)}: draw.{quantity}: drawn twice")
    given |= changes.of_document()
    try:
        document = Document.model_validate(given)
    except ValidationError as error:
        options = {name: f"--{name}" for name in changes.of_document()}
        branches = ("str", LawEntry.__name__)
        said = problems.told(error, Document, source, file.lines, branches, options)
        raise CampaignError(said) from error
    try:
        draws = _draws(document, changes)
        variants = tuple(_variants(document, folder, where, allow_commands, changes))
        draws = replace(draws, folder=variants[0].beside)
        if document.seeds is not None:
            draws = SeedDraws.of(variants[0].mission, document.seeds, document.seed, document.n)
        campaign = Campaign(name, source, text, document, draws, variants, changes)
        _check(campaign)
    except (MissionError, DrawError, ParameterError, AirframeError) as error:
        raise CampaignError(f"{source}: {error}") from error
    return campaign


def _flat(tables: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Key and distribution; a table that holds nothing but tables is no distribution."""
    for name, value in tables.items():
        nested = (
            isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values())
        )
        if nested:
            yield from _flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def _draws(document: Document, changes: Changes) -> Draws:
    for names in {tuple(document.draw), *map(tuple, document.points)}:
        check_apart(names)
    drawn = tuple((key(name), each) for name, each in document.draw.items())
    tables = {each.table for each, _ in drawn}
    tables |= {key(name).table for point in document.points for name in point}
    if both := sorted(tables & changes.set.keys()):
        raise DrawError(f"--set {both[0]}: the campaign draws this quantity")
    tables |= document.set.keys() | changes.set.keys()
    rare = document.rare
    return Draws(
        document.method, document.seed, document.n, drawn, document.points, SEED in tables,
        stage=0 if rare is None else rare.stage, stages=0 if rare is None else rare.stages,
        proposals={0: Mixture.standard(len(drawn))},
    )  # fmt: skip


@contextmanager
def _blamed(where: str = "") -> Iterator[None]:
    """What is wrong with a mission is said of a place in the campaign's file. Raises CampaignError."""
    try:
        yield
    except MissionError as error:
        raise CampaignError(f"{where}: {error}" if where else str(error)) from error


def _variants(
    document: Document, folder: Path, where: Callable[..., str], allow_commands: bool,
    changes: Changes,
) -> Iterator[Variant]:  # fmt: skip
    with _blamed(f"{where('mission')}: mission"):
        mission = _mission(document.mission, folder)
        if mission.flight.script is not None:
            allowed(mission, allow_commands)
    runs_in = None if mission.flight.script is None else mission.folder.absolute()
    if document.airframe is not None:
        airframe = str(_absolute(document.airframe, folder, ".toml"))
        with _blamed():
            mission = with_airframe(mission, airframe, where("airframe"))
    labels: list[str] = []
    for i, entry in enumerate(document.laws or (None,)):
        own: dict[str, Any] = {}
        made, law, label = mission, entry, None
        if isinstance(entry, LawEntry):
            law, own, label = entry.law, entry.set, entry.label
        if isinstance(law, str):
            at = f"{where('laws', i)}: laws[{i}]"
            with _blamed():
                made = with_law(made, str(_absolute(law, folder, ".py")), at)
        if values := {**document.set, **own}:
            made = with_values(made, values, "set")
        if changes.set:
            made = with_values(made, changes.set, "--set")
        if document.success is not None:
            made = with_values(made, {"expect": document.success}, "[success]")
        if (rare := document.rare) is not None:
            bound = rare.model_dump(include={"limit", "at_least"}, exclude_none=True)
            expected = {rare.metric: bound, "reached": False}
            made = with_values(made, {"expect": expected}, "[rare]")
        if document.fly == LAW and (made.flight.items or made.flight.arrive):
            raise MissionError(
                'fly = "law": a mission of items, or one that ends on arrival, needs a vehicle:'
                ' fly = "vehicle"'
            )
        refuse_link_faults(made)
        if document.fly == LAW and made.parameters.keys() - PASSED_ON:
            raise MissionError('fly = "law": [vehicle.params] need a vehicle: fly = "vehicle"')
        if document.fly == LAW:
            refuse_faults_of_autopilot(made)
        if document.fly == LAW and runs_in is not None:
            raise MissionError('fly = "law": a script needs a vehicle: fly = "vehicle"')
        label = label or made.flown.name
        if label in labels:
            raise MissionError(f"two laws are called {label} (give one of them a label)")
        labels.append(label)
        made = from_tables(made.name, anchored(made))
        if runs_in is not None:
            made = replace(made, folder=runs_in)
        base = {name: value.value for name, value in made.values_in_force().items()}
        yield Variant(label, made, base, runs_in, mission.folder.absolute())


def _mission(name: str, folder: Path) -> Mission:
    beside = folder / name
    return mission_file.load(beside if name.endswith(".toml") and isfile(beside) else name)


def _absolute(name: str, folder: Path, suffix: str) -> str | Path:
    return (folder / name).absolute() if name.endswith(suffix) else name


def anchored(mission: Mission) -> dict[str, Any]:
    """A mission's tables, with the files that they name by absolute paths."""
    given = json.loads(json.dumps(mission.given))
    folder = mission.folder.absolute()

    def anchor(table: Any, name: str, suffix: str) -> None:
        if isinstance(table, dict) and name in table and str(table[name]).endswith(suffix):
            table[name] = str(folder / table[name])

    anchor(given, "airframe", ".toml")
    anchor(given.get("law"), "module", ".py")
    wind, flight = given.get("wind", {}), given.get("flight", {})
    for table in (wind, wind.get("field"), *flight.get("items", ())):
        anchor(table, "file", "")
    anchor(flight, "plan", "")
    return dict(given)


def _check(campaign: Campaign) -> None:
    """Every quantity at the ends of its distribution, before anything is flown.

    Raises MissionError, DrawError, ParameterError, AirframeError.
    """
    draws = campaign.draws
    middle: dict[str, Any] = draws.quantities(0)
    tried: list[dict[str, Any]] = [middle]
    for each, distribution in draws.drawn:
        tried += [{**middle, each.name: end} for end in distribution.ends()]
    tried += [dict(point) for point in campaign.document.points[:MOST_DIMENSIONS]]
    for variant in campaign.variants:
        refused = []
        for quantities in tried:
            values = draws.values(0, quantities, variant.base)
            try:
                mission = with_values(variant.mission, values, "[draw]")
                refused.append(refused_gains(mission, scenario(mission)))
            except MissionError as error:
                raise MissionError(f"{error}{_hint(draws)}") from error
        if campaign.document.seeds is None and all(
            refused
        ):  # a single refused draw is a lost flight; nothing but refused draws is a mistake
            raise MissionError(refused[0])


def _hint(draws: Draws) -> str:
    open_ended = [
        each.name
        for each, distribution in draws.drawn
        if distribution.kind in ("normal", "log_normal")
        and (distribution.low is None or distribution.high is None)
    ]
    return (
        f" (low and high bound a normal distribution: {', '.join(open_ended)})"
        if open_ended
        else ""
    )
