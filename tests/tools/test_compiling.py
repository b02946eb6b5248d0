"""Progress of compiling: the kernels that are counted, and the lines that a person reads."""

from __future__ import annotations

from fcu.kernel import cache, compile
from gcs_tools.cli import terminal
from gcs_tools.cli.terminal import Terminal
from gcs_tools.flight import compiling
from gcs_tools.flight.compiling import Compiling


def test_kernels_that_came_since_are_counted(tmp_path, monkeypatch):
    for package in ("fcu", "own_law"):
        monkeypatch.setitem(compile._folders, package, cache.Folder(tmp_path / package))
    monkeypatch.setattr(compiling, "LOOK_S", 0.0)
    ours, own = compile._folders["fcu"], compile._folders["own_law"]
    ours.write("before-0.kernel", b"")
    told = []
    watched = Compiling("own_law", lambda done, of, wall_s: told.append((done, of)))
    watched.look()
    ours.write("a-0.kernel", b"")
    watched.look()
    ours.write("a-1.inner", b"")
    own.write("b-0.kernel", b"")
    (own.path / ".new-half").touch()
    watched.look()
    assert told == [(1, compiling.ABOUT), (3, compiling.ABOUT)]


def test_off_a_terminal_a_line_is_printed_now_and_then(capsys, monkeypatch):
    shown = Terminal()
    clock = [100.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    for second in range(21):
        clock[0] = 100.0 + second
        shown.compiling(second + 1, 400, float(second))
    told = [line.split()[1] for line in capsys.readouterr().err.splitlines()]
    assert told == ["1", "6", "11", "16", "21"]
