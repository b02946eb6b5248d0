"""`gcs plot`: the standard figures of a recording, and the errors of several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface.files.spelling import suggestion
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.recording.reader import Recording

NAMES = ("flight", "tracking", "limits", "prediction", "estimates", "wind", "timing")
FORMATS = ("png", "svg", "pdf")
OVERLAYS = (
    "errors",
    "position",
    "velocity",
    "attitude",
    "margin",
    "thrust",
    "mass",
    "wind",
)  # of several
SEVERAL = "errors"  # what is drawn of several recordings, if nobody says
MOST_NAMED = 3  # of them, in the figure's name


def _names(
    _context: click.Context, _option: click.Parameter, value: str | None
) -> tuple[str, ...] | None:
    if value is None:
        return None
    return tuple(dict.fromkeys(name.strip() for name in value.split(",")))


def _known(what: tuple[str, ...], there: tuple[str, ...]) -> tuple[str, ...]:
    """The names themselves. Raises click.BadParameter for one that is not there."""
    for name in what:
        if name not in there:
            known = f"{suggestion(name, there)}; there are {', '.join(there)}"
            raise click.BadParameter(f"no figure {name!r}{known}", param_hint="'--what'")
    return what


@click.command(
    epilog="\b\n"
    "flight      the overview that gcs fly draws\n"
    "tracking    did it go where the reference went?\n"
    "limits      how close to saturation?\n"
    "prediction  does the predictor hold?\n"
    "estimates   are the estimates right? with truth and the bounds of projection\n"
    "wind        is the wind known? RMS against the truth, from 1 s after\n"
    "            take-over\n"
    "timing      did both processes keep time?\n\n"
    "Exit codes: 0 drawn, 2 the recording cannot be read, a figure that was asked for by name\n"
    "cannot be drawn of it, or a file cannot be written; 130 interrupted."
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), callback=arguments.recording, metavar="RUN...")  # fmt: skip
@click.option("--what", callback=_names, metavar="NAME,NAME...", help="Figures to draw; default: all available.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE_OR_FOLDER", help="Default: <RUN>-<NAME>.png beside RUN; of several, a new <NAME>-<RUN>-<RUN>.png in the working directory. A file name if only one figure is drawn.")  # fmt: skip
@click.option("--from", "t_from", type=float, metavar="S", help="Start of the time window, s.")
@click.option("--to", "t_to", type=float, metavar="S", help="End of the time window, s.")
@click.option("--format", "kind", type=click.Choice(FORMATS), help="Default: the suffix of --out, or png.")  # fmt: skip
@arguments.as_json("Print paths and numbers as JSON.")
def plot(
    runs: tuple[Path, ...], what: tuple[str, ...] | None, out: Path | None, t_from: float | None,
    t_to: float | None, kind: str | None, as_json: bool,
) -> int:  # fmt: skip
    """Draw the standard figures of the recording RUN, each with its key figure.

    RUN is a recording or the folder of a run. Several are drawn over each other in one figure: their
    errors, or --what of errors, position, velocity, attitude, margin, thrust, mass and wind. Prints where
    each figure is.
    """
    from gcs_tools.recording.reader import RecordingError, read

    if len(runs) > 1:
        overlays = _known(what or (SEVERAL,), OVERLAYS)
        return _several(runs, out, (t_from, t_to), kind, as_json, overlays)
    (run,) = runs
    names = _known(what or NAMES, NAMES)
    try:
        place, kind = _places(run, names, out, kind)
        recording = read(run)
        _inside(recording, t_from, t_to)
        drawn, failed = _draw(recording, names, place, kind, (t_from, t_to), what is not None)
        for name, found in drawn.items():
            if not as_json and found["path"] is not None:
                print_line(f"{found['path']}  {name}: {found['answer']}")
        if as_json:
            print_json(drawn)
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        raise Failure(f"{error.filename or 'standard output'}: {error.strerror}", USAGE) from error
    return USAGE if failed else OK


def _several(
    runs: tuple[Path, ...], out: Path | None, window: tuple[float | None, float | None],
    kind: str | None, as_json: bool, what: tuple[str, ...],
) -> int:  # fmt: skip
    named = "-".join(what)
    try:
        place, kind = _places(runs[0], (named,), out, kind)
        is_named = out is not None and not out.is_dir()
        path = place(named) if is_named else _free(out or Path(), _stem(runs, named), kind)
    except OSError as error:
        raise Failure(f"{error.filename}: {error.strerror}", USAGE) from error
    found = draw_several(runs, path, kind, window, what)
    if as_json:
        print_json({named: {"path": str(path), "runs": found}})
    else:
        print_line(f"{path}  {', '.join(what)} of {len(runs)} flights")
    return OK


def _name(run: Path) -> str:
    """What a run is called: by its folder, or by its recording."""
    return run.resolve().parent.name if run.name == arguments.RECORDED else run.stem


def _stem(runs: Sequence[Path], what: str) -> str:
    """The name of the figure of several runs."""
    more = (
        "-".join(map(_name, runs[1:])) if len(runs) <= MOST_NAMED else f"and-{len(runs) - 1}-more"
    )
    return f"{what}-{_name(runs[0])}-{more}"


def _free(folder: Path, stem: str, kind: str) -> Path:
    """A file that is not there yet."""
    numbers = ("", *(f"-{n}" for n in range(1, 1000)))
    paths = [folder / f"{stem}{number}.{kind}" for number in numbers]
    return next((path for path in paths if not path.exists()), paths[0])


def draw_several(
    runs: Sequence[Path], path: Path, kind: str,
    window: tuple[float | None, float | None] = (None, None), what: Sequence[str] = (SEVERAL,),
) -> dict[str, dict[str, float | None]]:  # fmt: skip
    """Draw recordings over each other to `path` as `kind`; the metrics of each. Raises Failure."""
    from gcs_tools.judging.comparison import distinct
    from gcs_tools.judging.recorded_flight import engaged_ticks
    from gcs_tools.pictures.plot.overlays import save
    from gcs_tools.recording.reader import RecordingError, read

    flights, remarks = {}, []
    at = [run.resolve() for run in runs]
    names = distinct(
        [run.parent if run.name == arguments.RECORDED else run.with_suffix("") for run in at]
    )
    try:
        for name, run in zip(names, runs, strict=True):
            recording = read(run)
            _inside(recording, *window)
            flights[name] = engaged_ticks(recording).window(*window)
            remarks += [f"{name}: {remark}" for remark in _remarks(recording)]
        return save(flights, path, kind, remarks, what)
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        raise Failure(f"{path}: {error.strerror}", USAGE) from error


def _places(
    run: Path, names: tuple[str, ...], out: Path | None, kind: str | None
) -> tuple[Callable[[str], Path], str]:
    """Where each figure goes, and as what. Raises click.UsageError, OSError."""
    ending = "" if out is None or out.is_dir() else out.suffix.lower().removeprefix(".")
    if out is not None and ending:
        if ending not in FORMATS:
            raise click.UsageError(f"--out {out}: ends in none of {', '.join(FORMATS)}")
        if kind not in (None, ending):
            raise click.UsageError(f"--out {out} is not --format {kind}")
        if len(names) > 1:
            raise click.UsageError(f"--out {out}: a folder for {len(names)} figures, please")
        return lambda _: out, ending
    kind = kind or "png"
    folder = out or run.parent
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    return lambda name: folder / f"{run.stem}-{name}.{kind}", kind


def _inside(recording: Recording, t_from: float | None, t_to: float | None) -> None:
    """Refuse a window that holds nothing of the recording. Raises click.UsageError."""
    if t_from is not None and t_to is not None and not t_from < t_to:
        raise click.UsageError(f"--from {t_from:g} is not before --to {t_to:g}")
    times = [rows["t"][[0, -1]] for rows in (recording.plant, recording.fcu) if len(rows)]
    if not times:
        return
    first, last = min(float(t[0]) for t in times), max(float(t[1]) for t in times)
    if (t_from is not None and not t_from <= last) or (t_to is not None and not t_to >= first):
        raise click.UsageError(f"nothing in that window: {recording.path} has {first:g} to {last:g} s")  # fmt: skip


def _draw(
    recording: Recording, names: tuple[str, ...], place: Callable[[str], Path], kind: str,
    window: tuple[float | None, float | None], asked: bool,
) -> tuple[dict[str, dict[str, Any]], bool]:  # fmt: skip
    """What was drawn and its numbers, by name, and whether one that was asked for was not."""
    from gcs_tools.pictures.plot.figures import STANDARD, save
    from gcs_tools.pictures.plot.window import Missing, Window
    from gcs_tools.recording.table import UnknownColumn

    remarks = _remarks(recording)
    for remark in remarks:
        click.echo(f"{recording.path}: {remark}", err=True)
    shown = Window.of(recording, *window)
    mission = recording.metadata.get("mission")
    source = f"{mission}, {recording.path.name}" if mission else recording.path.name
    drawn: dict[str, dict[str, Any]] = {}
    failed = False
    for name in names:
        path = place(name)
        try:
            found = save(name, shown, path, kind, source, remarks)
        except (Missing, UnknownColumn) as missing:
            click.echo(f"{'Error: ' if asked else ''}{name}: not drawn, {missing}", err=True)
            drawn[name] = {"path": None, "missing": str(missing)}
            failed = failed or asked
            continue
        drawn[name] = {"path": str(path), "answer": STANDARD[name].answer(found), **found}
    return drawn, failed


def _remarks(recording: Recording) -> tuple[str, ...]:
    """What is not whole about a recording."""
    from gcs_tools.recording.retention import EVERY

    remarks = []
    if not recording.complete:
        rows = recording.fcu if len(recording.fcu) else recording.plant
        last = f" after {rows['t'][-1]:.3f} s" if len(rows) else ""
        remarks.append(
            f"The recording was cut short{last}: what came later is missing (gcs recover)."
        )
    if (every := recording.metadata.get(EVERY, "1")) != "1":
        remarks.append(f"Light recording: one tick in {every}.")
    if recording.lost:
        lost = ", ".join(f"{n} of {topic}" for topic, n in recording.lost.items())
        remarks.append(f"Messages lost: {lost}.")
    return tuple(remarks)
