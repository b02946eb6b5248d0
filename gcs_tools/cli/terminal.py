"""What a person sees of a flight: progress in simulation time, then the verdict."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fcu.interface.files.input_file import plain
from gcs_tools.cli.output import is_unread, silence
from gcs_tools.exit_codes import MISSED, OK
from gcs_tools.flight.display import Display

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from gcs_tools.judging.result import Result

INDENT = "  "  # of a sentence's second line and those after it
COMMAND = ": gcs "  # what begins a command at the end of a sentence
DRAW_S = 0.1  # wall: between two looks of a bar
LINE_S = 5.0  # wall: between two lines off a terminal about how far it has come


class PipedConsole(Console):
    """A console that falls silent when nobody reads it any more (`gcs fly ... | head`)."""

    def _check_buffer(self) -> None:
        try:
            super()._check_buffer()
        except OSError as error:  # a closed terminal, which rich does not know
            if not is_unread(error):
                raise
            self.on_broken_pipe()

    def on_broken_pipe(self) -> None:
        """The flight goes on, and the exit code is still its own."""
        self.quiet = True
        silence(self.file)


class Terminal(Display):
    """Progress on standard error, verdicts on standard output."""

    def __init__(self) -> None:
        self._log = PipedConsole(stderr=True, highlight=False)
        self._out = PipedConsole(highlight=False)
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._said_s = 0.0  # wall: when such a line was printed

    @contextmanager
    def _without_bar(self) -> Iterator[None]:
        """For what is said on standard output while a bar is shown."""
        if self._bar is not None:
            self._bar.stop()
        yield
        if self._bar is not None:
            self._bar.start()

    def note(self, text: str) -> None:
        """One line."""
        self._log.print(Text(text, style="dim"), soft_wrap=True)

    def compiling(self, done: int, of: int, wall_s: float) -> None:
        """The bar, or a line now and then."""
        told = f"compiling: {done} of about {of} kernels"
        if 10 * done >= of:  # before, nobody can tell
            told += f", {wall_s * (of - done) / done:.0f} s to go"
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=of, told=told, refresh=True)
        elif (now := time.monotonic()) - self._said_s >= LINE_S:
            self._said_s = now
            self.note(told)

    @contextmanager
    def flight(self, mission: str, duration_s: float) -> Iterator[Callable[[float], None]]:
        """A bar in simulation time, drawn when it is told: no thread may run where a flight forks."""
        if not self._log.is_terminal:
            yield lambda time_s: None
            return
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=40),
            TaskProgressColumn(),
            TextColumn("{task.fields[told]}"),
            console=self._log,
            transient=True,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._bar = bar
        with bar:
            self._task = task = bar.add_task(mission, total=duration_s, told="")
            drawn = 0.0

            def tell(time_s: float) -> None:
                nonlocal drawn
                due = (now := time.monotonic()) - drawn >= DRAW_S
                drawn = now if due else drawn
                told = f"{time_s:5.1f} / {duration_s:.1f} s"
                bar.update(task, completed=time_s, total=duration_s, told=told, refresh=due)

            try:
                yield tell
            finally:
                self._bar = None

    def verdict(self, result: Result, folder: str) -> None:
        """The title, a table of the expectations, and where the run is."""
        with self._without_bar():
            self._verdict(result, folder)

    def closing(
        self, passed: int, of: int, wall_s: float, failed: Sequence[str], cut: Sequence[str],
        left: Sequence[str],
    ) -> None:  # fmt: skip
        """How many passed and which failed, in one line; of an interrupted call which did not fly."""
        style = "green" if passed == of else "red"
        said = f"{passed} of {of} passed in {wall_s:.0f} s"
        said += f"; failed: {', '.join(failed)}" if failed else ""
        self._out.print(Text(said, style=style), soft_wrap=True)
        for what, names in (("interrupted", cut), ("not flown", left)):
            if names:
                self._out.print(Text(f"{what}: {', '.join(names)}", style=style), soft_wrap=True)

    def _verdict(self, result: Result, folder: str) -> None:
        self._out.print(Text(result.title, style="bold"))
        if result.changes:
            self._out.print(Text(f"changed: {', '.join(result.changes)}"), soft_wrap=True)
        if result.error:
            self._out.print(Text(plain(result.error, kept="\n"), style="red"), soft_wrap=True)
        if result.expectations:
            table = Table(box=None, pad_edge=False, show_header=True, header_style="dim")
            table.add_column("")
            table.add_column("expected")
            table.add_column("measured", justify="right")
            for line in result.expectations:
                style = "red" if line.is_missed else "green" if line.passed else "dim"
                mark = Text(
                    "MISSED" if line.is_missed else "met" if line.passed else "-", style=style
                )
                table.add_row(mark, line.text, Text(line.shown, style=style))
            self._out.print(table)
        for line in result.expectations:
            if line.why is not None:
                no_value = " has no value" if line.value is None else ""
                self._say(f"{line.name}{no_value}: {line.why}")
        for sentence in result.causes:
            self._say(sentence)
        told = result.script.told() if result.script else []
        for warned in (*told, *map(str, result.warnings)):
            self._say(warned, "yellow")
        factor = result.real_time_factor
        shown = f"{factor:.0f}" if factor >= 10.0 else f"{factor:.2g}"
        speed = f", {shown} times real time" if result.wall_time_s else ""
        verdict = {OK: Text("passed: ", "green"), MISSED: Text("failed: ", "red")}
        self._out.print(
            verdict.get(result.exit_code, Text())
            + Text(f"{result.sim_time_s:.2f} s at {result.rate_hz:g} Hz{speed}; run in {folder}"),
            soft_wrap=True,
        )

    def _say(self, text: str, style: str = "") -> None:
        """A sentence, its further lines indented; a command at its end on a line of its own, to copy."""
        sentence, command = text, ""
        if COMMAND in text:
            sentence, _, command = text.partition(COMMAND)
            sentence, command = f"{sentence}:", f"{INDENT}gcs {command}"
        for line in textwrap.wrap(
            sentence, self._out.width, subsequent_indent=INDENT, break_long_words=False,
            break_on_hyphens=False,
        ):  # fmt: skip
            self._out.print(Text(line, style=style), soft_wrap=True)
        if command:
            self._out.print(Text(command, style=style), soft_wrap=True)


@contextmanager
def status(first: str) -> Iterator[Callable[[str], None]]:
    """A line on standard error, `first` and then what it is told; none off a terminal."""
    console = PipedConsole(stderr=True, highlight=False)
    if not console.is_terminal:
        yield lambda line: None
        return
    with console.status(first, spinner="point") as shown:
        yield shown.update
