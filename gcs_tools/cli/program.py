"""`gcs` itself: its commands by group, each imported when it is asked for."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import threading
from importlib import import_module
from typing import Any

import click

from fcu.interface.files.spelling import suggestion_or_list
from fcu.interface.ports import table
from gcs_tools.cli import guardian
from gcs_tools.cli.output import is_unread, silence, write_anywhere
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED, OK, USAGE
from gcs_tools.flight import interrupts

# a command is the module gcs_tools.cli.<name>, and the function of that name in it
GROUPS = {
    "Flying": ("fly", "test", "up", "setpoint", "fault", "reset"),
    "Before flight": ("envelope", "airframe", "plan", "wind"),
    "Laws": ("tune", "compare"),
    "Many flights": ("campaign",),
    "Recordings": ("plot", "view", "recover", "replay"),
    "Live": ("monitor", "record", "topics", "publish"),
}


class Program(click.Group):
    """Ends with what a command returns, and with 130 when it is interrupted, wherever it is."""

    def list_commands(self, _context: click.Context) -> list[str]:
        """All of them, in the order of their groups."""
        return [name for names in GROUPS.values() for name in names]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """One of them, imported."""
        if name not in self.list_commands(context):
            return None
        command: click.Command = getattr(import_module(f"gcs_tools.cli.{name}"), name)
        return command

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is named; of a name that is none, which one it is close to."""
        names = self.list_commands(context)
        if args and args[0] not in names and not args[0].startswith("-"):
            known = suggestion_or_list(args[0], names, most=len(names))
            context.fail(f"No such command {args[0]!r}{known}")
        return super().resolve_command(context, args)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """For --help: a list for each group."""
        width = formatter.width - 6 - max(map(len, self.list_commands(context)))
        for title, names in GROUPS.items():
            found = [(name, self.get_command(context, name)) for name in names]
            with formatter.section(title):
                formatter.write_dl(
                    [(name, made.get_short_help_str(width)) for name, made in found if made]
                )

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the command line, and exit.

        Without arguments it is the process's own command line: then signals are heard from here on,
        and ignored once the exit code is known.
        """
        is_own = not args and options.get("args") is None
        code = INTERRUPTED
        try:
            if is_own:
                interrupts.install()
                guardian.install()
            code = self._code(*args, **options)
        except KeyboardInterrupt:
            pass  # it came when there was nothing left to interrupt
        finally:
            if is_own:
                interrupts.ignore()
                guardian.leave()
        if bus := sys.modules.get("gcs_tools.live.bus"):
            bus.leave(code)  # whatever threads Zenoh still has
        if code == INTERRUPTED:
            _leave_threads()
        sys.exit(code)

    def _code(self, *args: Any, **options: Any) -> int:
        """Run the command line; its exit code."""
        try:
            write_anywhere()
            code = super().main(*args, **{**options, "standalone_mode": False})
        except click.ClickException as error:
            error.show()
            code = error.exit_code
        except (click.Abort, KeyboardInterrupt):
            code = INTERRUPTED
        except OSError as error:  # of standard output: a full disk, a closed terminal
            if is_unread(error) and interrupts.is_heard():
                for stream in (sys.stdout, sys.stderr):
                    silence(stream)
                return INTERRUPTED
            if error.errno == errno.ENAMETOOLONG:  # of what a person typed
                click.echo(f"Error: {error.filename}: {error.strerror}", err=True)
                return USAGE
            where = f"{error.filename}: " if error.filename else ""
            click.echo(f"Error: {where}{error.strerror or error}", err=True)
            guardian.leave()
            os._exit(INFRASTRUCTURE)  # what is still buffered would fail again
        except Exception:
            if not interrupts.is_heard():
                raise
            return INTERRUPTED  # matplotlib's C++ makes another error of an interruption
        return code if isinstance(code, int) else OK


def _leave_threads() -> None:
    """End the process now if it would wait for other threads: a law in one may go round and round."""
    if any(
        each is not threading.main_thread() and not each.daemon for each in threading.enumerate()
    ):
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(INTERRUPTED)


@click.group(cls=Program, epilog=f"\b\n{table()}")
@click.version_option(package_name="m-mrac")
def main() -> None:
    """Ground tools of the M-MRAC flight stack."""
