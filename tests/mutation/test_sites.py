"""The tool that changes the source: what it changes, what it draws, and the arithmetic it runs with."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from tests.mutation import plain, sites

HERE = Path(__file__).parent
ROOMS = tomllib.loads((HERE / "rooms.toml").read_text())


def changed(source):
    return {
        (site.operator, source[: site.start] + site.text + source[site.end :])
        for site in sites.sites(source.encode())
    }


@pytest.mark.parametrize(
    ("source", "operator", "becomes"),
    [
        ("a = b + c\n", "sign", "a = b - c\n"),
        ("a = -b\n", "sign", "a = b\n"),
        ("a = (b) * (c)\n", "product", "a = (b) / (c)\n"),
        ("a = b < c\n", "limit", "a = b <= c\n"),
        ("a = b < c\n", "comparison", "a = b > c\n"),
        ("a = b is not c\n", "comparison", "a = b is c\n"),
        ("a = minimum(b, c)\n", "limit", "a = maximum(b, c)\n"),
        ("if not (b or c): a = d\n", "condition", "if  (b or c): a = d\n"),
        ("a = b and c\n", "condition", "a = (b or c)\n"),
        ("a = b[1]\n", "index", "a = b[2]\n"),
        ("a = b[:-1]\n", "sign", "a = b[:1]\n"),
        ("a = 1e3 * b\n", "unit", "a = (1e3 * 10) * b\n"),
        ("a = math.radians(b)\n", "unit", "a = math.degrees(b)\n"),
        ("a = 0.5 * b\n", "constant", "a = 1.0 * b\n"),
        ("a = True\n", "constant", "a = False\n"),
        ("a = f(b, c, d)\n", "arguments", "a = f(b, d, c)\n"),
        ("a = f(x=b, y=c)\n", "field", "a = f(x=c, y=b)\n"),
        ("a = v.x\n", "field", "a = v.y\n"),
    ],
)
def test_each_kind_of_change(source, operator, becomes):
    assert (operator, becomes) in changed(source)


def test_words_types_and_imports_are_not_changed():
    source = '"""1 + 1."""\nimport a\nx: Literal[1]\n@f(1)\ndef g(a: T[1]) -> T[2]:\n    raise E(1 + 2)\n'
    assert changed(source) == set()


def named(tmp_path, name, source):
    path = tmp_path / name
    path.write_text(source)
    return {mutant.name for mutant in sites.mutants(tmp_path, "room", [path])}


def test_code_that_moves_keeps_its_mutants(tmp_path):
    moved = named(tmp_path, "b.py", "import math\n\n\ndef g(b, c):\n    return b - 2.0 * c\n")
    assert named(tmp_path, "a.py", "def f(b, c):\n    return b - 2.0 * c\n") == moved
    assert len(moved) == 3


def test_a_draw_takes_each_kind_in_turn_and_a_line_once(tmp_path):
    path = tmp_path / "a.py"
    path.write_text("a = b - c - d - e\nf = g < h\ni = j[3]\nk = l + m\n")
    drawn = sites.drawn(sites.mutants(tmp_path, "room", [path]), 4)
    assert sorted(mutant.line for mutant in drawn) == [1, 2, 3, 4]
    assert len({mutant.operator for mutant in drawn[:3]}) == 3
    for mutant in drawn:
        before, after = mutant.lines(path.read_bytes())
        assert before != after
        compile(mutant.applied(path.read_bytes()), "a.py", "exec")


def test_every_room_has_five_of_two_hundred():
    assert sum(room["count"] for room in ROOMS.values()) == 200
    assert min(room["count"] for room in ROOMS.values()) >= 5
    for room in ROOMS.values():
        assert sites.files(HERE.parents[1], room["paths"], room.get("without", ()))
        assert all((HERE.parent / name).exists() for name in room["tests"])


def test_five_percent_at_most_are_called_equivalent():
    equivalents = tomllib.loads((HERE / "equivalents.toml").read_text())
    assert len(equivalents) <= 10
    assert all(reason for reason in equivalents.values())


def test_uncompiled_kernels_divide_as_compiled_ones():
    source = b"@kernel\ndef f(a, b):\n    return (a) / (b * 2.0) / 3.0\n"
    scope = {"kernel": lambda function: function, "_ieee_divided": plain._ieee_divided}
    prepared = plain.prepared("fcu/laws/x.py", source)
    exec(prepared, scope)
    assert prepared.count(b"\n") == source.count(b"\n")
    assert scope["f"](6.0, 0.5) == 2.0
    assert scope["f"](1.0, 0.0) == math.inf
    assert scope["f"](-1.0, 0.0) == -math.inf
    assert math.isnan(scope["f"](0.0, 0.0))
