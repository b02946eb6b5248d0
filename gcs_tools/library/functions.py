"""The functions of `from gcs_tools import ...`, each the work of a command, with a typed result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs_tools.campaigns.analysis import Analysis
    from gcs_tools.campaigns.regression import Held
    from gcs_tools.campaigns.tuning import Tuned
    from gcs_tools.judging.airframe_check import AirframeCheck
    from gcs_tools.recording.reader import Recording


@dataclass(frozen=True)
class Campaigned:
    """The flights of a campaign, and what they say."""

    folder: Path
    passed: bool  # what its [expect] says is shown; True if it says nothing
    analysis: Analysis  # success, metrics and causes, law by law
    flights: Any  # pyarrow.Table, a row for each flight

    def _repr_html_(self) -> str:
        """A table of success and metrics, for a notebook."""
        from gcs_tools.recording.notebook import table

        rows = [
            (of.law, f"{of.success.successes} of {of.success.of}",
             f"{100.0 * of.success.low:.1f} to {100.0 * of.success.high:.1f} %")
            for of in self.analysis.laws
        ]  # fmt: skip
        return table(str(self.folder), ("law", "succeed", "interval"), rows)


def read(run: Path | str) -> Recording:
    """Read a recording.

    run : the folder of a run, or its flight.mcap.

    Returns a Recording. `fcu` and `plant` are tables with a row for each control tick, of what the
    controller told and of the truth: `table["state.r_E"]` is a NumPy array, float64 (n, 3), `table.names` has all
    columns. `metadata`, `params` and `events` are what they say. Raises RecordingError.
    """
    from gcs_tools.recording import reader

    path = Path(run)
    return reader.read(path / "flight.mcap" if path.is_dir() else path)


def compare(
    run: Path | str, baseline: Path | str, *, exact: bool = False, tolerance: float = 0.005
) -> list[Held]:  # fmt: skip
    """Hold flights against a baseline, as `gcs compare RUN BASELINE --fail` does.

    run, baseline : a run each, or a folder with runs below it.
    exact : to the bit, with the first tick at which they differ.
    tolerance : part of the baseline's mean by which a metric may be worse in flights of the same seeds.

    Returns a Held for each mission: `passed`, `worse`, `failed`, `changed`, `parted`. Raises CompareError and
    RegressionError for what cannot be compared.
    """
    from gcs_tools.campaigns.regression import held_against
    from gcs_tools.judging.comparison import all_flown, below

    mine, theirs = (all_flown(below(Path(each))) for each in (run, baseline))
    return held_against(mine, theirs, exact, tolerance)


def campaign(
    file: Path | str, *, out: Path | str, flights: int | None = None, seed: int | None = None,
    settings: Sequence[str] = (), jobs: int | None = None, allow_commands: bool = False,
) -> Campaigned:  # fmt: skip
    """Fly a mission many times with its uncertain values sampled, as `gcs campaign FILE` does.

    file : a campaign's file, or the name of a shipped one, but not one that looks for rare failures ([rare]).
    out : the folder of its flights, new or of the same campaign, which then goes on.
    flights : of each law, in place of the file's.
    seed : of the draws, in place of the file's.
    settings : TABLE.KEY=VALUE each, of the mission, as `--set` takes them.
    jobs : worker processes. None: as many as cores.
    allow_commands : the mission may name a command, which is run.

    Raises CampaignError, RunningError for workers that fail, OSError.
    """
    from gcs_tools.campaigns import analysis, campaign_file, store
    from gcs_tools.campaigns.fingerprint import fingerprint, of_the_draws
    from gcs_tools.campaigns.running import Ending, processes, run
    from gcs_tools.campaigns.verdict import verdict
    from gcs_tools.flight.side_by_side import cores

    changes = campaign_file.Changes(flights, seed, campaign_file.settings(settings))
    asked, folder = campaign_file.read(file, changes, allow_commands), Path(out)
    if asked.document.rare is not None:
        raise campaign_file.CampaignError(f"{file}: [rare]: fly it with gcs campaign {file}")
    with store.locked(folder):
        kept = store.Store(folder, asked, {**fingerprint(), **of_the_draws()})
        ending = Ending.of(asked, kept)
        with processes(jobs or cores()) as workers:
            run(asked, kept, workers, ending)
        path = kept.finish(ending.n or asked.n)
    table = analysis.read(path)
    found = analysis.analysis(asked, table)
    passed = not kept.worst_exit and all(each.passed for each in verdict(asked, found))
    return Campaigned(folder, passed, found, table)


def tune(
    law: str, *, airframe: str = "s1000", settings: Sequence[str] = (), procedure: Path | str | None = None
) -> Tuned:  # fmt: skip
    """Choose the gains of a law, as `gcs tune LAW` does. It writes no file.

    law : a name, or FILE.py.
    airframe : a name, or FILE.toml.
    settings : TABLE.KEY=VALUE each, as `--set` takes them.
    procedure : a file of how laws are tuned. None: the one that all laws are tuned by.

    Returns a Tuned: `best.gains` (key -> value), the costs of the defaults and of each search. Raises EntrantError,
    ProcedureError, MissionError, LawError.
    """
    from gcs_tools.campaigns import procedure as how
    from gcs_tools.campaigns import tuning
    from gcs_tools.campaigns.entrant import entrant, warm_up
    from gcs_tools.missions.mission import load

    followed = how.read(Path(procedure) if procedure is not None else how.SHIPPED)
    asked = entrant(law, airframe, settings=tuple(settings))
    warm_up([asked], load(followed.training.missions[0]))
    return tuning.tune(asked, followed)


def airframe(name: Path | str) -> AirframeCheck:
    """Check an airframe before flight, as `gcs airframe NAME` does.

    name : of a shipped one, or a FILE.toml.

    Returns an AirframeCheck: `flies`, `authority`, `channels`, `hover_time_s` and all else that
    `gcs airframe --json` has. Raises AirframeError.
    """
    from fcu.interface.airframe import AirframeError, find
    from fcu.interface.airframe import read as read_file
    from fcu.interface.parameter import ParameterError
    from gcs_tools.judging.airframe_check import airframe_check

    file = read_file(find(str(name)))
    try:
        return airframe_check(file)
    except ParameterError as error:
        raise AirframeError(f"{file.path}: {error}") from error
