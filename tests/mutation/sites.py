"""Places where one change of the source can be made, and the seeded drawing among them.

A mutant is one change: a slice of one file's text, replaced. Its name is a hash of the change and of
the expression around it, not of file or line: code that moves keeps its mutants.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

SEED = 27
LONGEST = 120  # characters of the expression around a change that name the mutant

COMPARISONS = {
    ast.Lt: ("<", "<=", ">"), ast.LtE: ("<=", "<", ">="), ast.Gt: (">", ">=", "<"),
    ast.GtE: (">=", ">", "<="), ast.Eq: ("==", None, "!="), ast.NotEq: ("!=", None, "=="),
    ast.Is: ("is", None, "is not"), ast.IsNot: ("is not", None, "is"),
    ast.In: ("in", None, "not in"), ast.NotIn: ("not in", None, "in"),
}  # fmt: skip
ARITHMETIC = {
    ast.Add: ("+", "-", "sign"), ast.Sub: ("-", "+", "sign"),
    ast.Mult: ("*", "/", "product"), ast.Div: ("/", "*", "product"),
}  # fmt: skip
EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
ANGLES = {"radians": "degrees", "degrees": "radians"}
FIELDS = {"x": "y", "y": "z", "z": "x", "north": "east", "east": "north", "phi": "theta",
          "theta": "phi", "T_min": "T_max", "low": "high", "high": "low"}  # fmt: skip
UNITS = {60.0, 180.0, 360.0, 1e7, 1e6, 1e3, 1e2, 10.0, 1e-1, 1e-2, 1e-3, 1e-6, 1e-7, 1e9, 1e-9}
SYMMETRIC = {*EXTREMES, "hypot", "dot", "add", "isclose", "array_equal", "isinstance", "getattr",
             "hasattr", "zip", "print", "issubclass", "TypeVar", "NewType", "field"}  # fmt: skip
UNSEEN = (
    ast.Raise,
    ast.Assert,
    ast.JoinedStr,
    ast.Import,
    ast.ImportFrom,
)  # words, or no behaviour


class Mutant(NamedTuple):
    """One change of one file."""

    name: str
    room: str
    operator: str
    path: str  # from the root
    line: int
    first: int  # lines of the statement, or of its head
    last: int
    start: int  # bytes of the file
    end: int
    text: str  # in their place

    def applied(self, source: bytes) -> bytes:
        """The file's text with the change in it."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def lines(self, source: bytes) -> tuple[str, str]:
        """The line of the change before and after it, or all lines that the change spans."""
        first = source.rfind(b"\n", 0, self.start) + 1
        last = source.find(b"\n", self.end)
        last = len(source) if last < 0 else last
        changed = source[first : self.start] + self.text.encode() + source[self.end : last]
        return (" ".join(part.decode().split()) for part in (source[first:last], changed))  # type: ignore[return-value]


class Site(NamedTuple):
    """A change as found in the tree of a file."""

    operator: str
    context: str
    line: int
    first: int
    last: int
    start: int
    end: int
    text: str


class _Finder:
    """Finds the sites of one file."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.found: list[Site] = []
        self.statement = (1, 1)

    def start(self, node: Any) -> int:
        return self.starts[node.lineno - 1] + int(node.col_offset)

    def end(self, node: Any) -> int:
        return self.starts[node.end_lineno - 1] + int(node.end_col_offset)

    def of(self, node: Any) -> str:
        return self.source[self.start(node) : self.end(node)].decode()

    def add(self, operator: str, context: str, node: Any, start: int, end: int, text: str) -> None:
        line = self.source.count(b"\n", 0, start) + 1
        self.found.append(Site(operator, context, line, *self.statement, start, end, text))

    def between(self, left: Any, right: Any, symbol: str) -> tuple[int, int] | None:
        """The bytes of an operator between two operands."""
        start, end = self.end(left), self.start(right)
        gap = re.sub(rb"#[^\n]*", lambda m: b" " * len(m[0]), self.source[start:end])
        pattern = r"\s+".join(map(re.escape, symbol.split()))
        found = re.search(pattern.encode(), gap)
        return found and (start + found.start(), start + found.end())

    def walk(self, node: ast.AST, context: str | None = None) -> None:
        if isinstance(node, UNSEEN):
            return
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            last = max(body[0].lineno - 1, node.lineno) if body else node.end_lineno
            self.statement = (node.lineno, last or node.lineno)
        if isinstance(node, ast.expr | ast.stmt | ast.keyword) and context is None:
            plain = not hasattr(node, "body") or isinstance(node, ast.Lambda | ast.IfExp)
            text = ast.unparse(node) if plain else ""
            if 0 < len(text) <= LONGEST:
                context = text
        if isinstance(node, ast.expr | ast.keyword):
            self.look(node, context or ast.unparse(node)[:LONGEST])
        for child in self.children(node):
            self.walk(child, context)

    def children(self, node: ast.AST) -> Iterator[ast.AST]:
        """All parts that compute something: no annotations, decorators, bases and docstrings."""
        left_out: Sequence[str] = (
            "annotation",
            "returns",
            "decorator_list",
            "bases",
            "type_comment",
        )
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        for name, value in ast.iter_fields(node):
            if name in left_out:
                continue
            for part in value if isinstance(value, list) else [value]:
                is_text = isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)
                if isinstance(part, ast.AST) and not is_text:
                    yield part

    def look(self, node: Any, context: str) -> None:
        match node:
            case ast.BinOp() if type(node.op) in ARITHMETIC and not _is_text(node):
                symbol, other, operator = ARITHMETIC[type(node.op)]
                if at := self.between(node.left, node.right, symbol):
                    self.add(operator, context, node, *at, other)
            case ast.UnaryOp(op=ast.USub()):
                self.add("sign", context, node, self.start(node), self.start(node) + 1, "")
            case ast.UnaryOp(op=ast.Not()):
                self.add("condition", context, node, self.start(node), self.start(node) + 3, "")
            case ast.BoolOp():
                symbol, other = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
                if len(node.values) == 2 and (at := self.between(*node.values, symbol)):
                    text = f"({self.source[self.start(node) : at[0]].decode()}{other}"
                    text += f"{self.source[at[1] : self.end(node)].decode()})"
                    self.add("condition", context, node, self.start(node), self.end(node), text)
            case ast.Compare(ops=[op]):
                symbol, limit, reverse = COMPARISONS[type(op)]
                at = self.between(node.left, node.comparators[0], symbol)
                if at and limit:
                    self.add("limit", context, node, *at, limit)
                if at and reverse:
                    self.add("comparison", context, node, *at, reverse)
            case ast.Subscript(slice=ast.Constant(value=int(n))) if n is not True:
                number = node.slice
                self.add("index", context, number, self.start(number), self.end(number), str(n + 1))
            case ast.Subscript(slice=ast.Slice(lower=low, upper=high)):
                for bound in (low, high):
                    if isinstance(bound, ast.Constant) and isinstance(bound.value, int):
                        text = str(bound.value + 1)
                        self.add("index", context, bound, self.start(bound), self.end(bound), text)
            case ast.Constant(value=bool(value)):
                self.add(
                    "constant", context, node, self.start(node), self.end(node), str(not value)
                )
            case ast.Constant(value=int(number) | float(number)):
                self.number(node, number, context)
            case ast.Call():
                self.call(node, context)
            case ast.Attribute(attr=attr) if attr in FIELDS:
                end = self.end(node)
                self.add("field", context, node, end - len(attr), end, FIELDS[attr])

    def number(self, node: Any, number: float, context: str) -> None:
        if abs(number) in UNITS:
            operator, other = "unit", f"({self.of(node)} * 10)"
        elif isinstance(number, int):
            operator, other = "constant", str(number + 1)
        else:
            operator, other = "constant", "1.0" if number == 0.0 else repr(2.0 * number)
        self.add(operator, context, node, self.start(node), self.end(node), other)

    def call(self, node: Any, context: str) -> None:
        function = node.func
        name = getattr(function, "attr", getattr(function, "id", ""))
        end = self.end(function)
        for table, operator in ((EXTREMES, "limit"), (ANGLES, "unit")):
            if name in table:
                self.add(operator, context, function, end - len(name), end, table[name])
        if name not in SYMMETRIC and not any(isinstance(a, ast.Starred) for a in node.args):
            for a, b in pairwise(node.args):
                self.swap("arguments", context, a, b)
        named = [word for word in node.keywords if word.arg]
        for a, b in pairwise(named):
            self.swap("field", context, a.value, b.value)

    def swap(self, operator: str, context: str, a: Any, b: Any) -> None:
        if ast.unparse(a) == ast.unparse(b) or _kind(a) is None or _kind(a) != _kind(b):
            return
        middle = self.source[self.end(a) : self.start(b)].decode()
        text = f"{self.of(b)}{middle}{self.of(a)}"
        self.add(operator, context, a, self.start(a), self.end(b), text)


def _is_text(node: ast.BinOp) -> bool:
    """A sum of texts or lists, or a path: any other operator raises TypeError."""
    parts = [node.left, node.right]
    if any(
        _kind(part) in (None, "text") or isinstance(part, ast.List | ast.Tuple) for part in parts
    ):
        return True
    path = re.compile("(?i)path|folder|root|home|parent|file")
    return isinstance(node.op, ast.Div) and any(path.search(ast.unparse(part)) for part in parts)


def _kind(node: ast.expr) -> str | None:
    """The kind of an argument: two kinds in each other's places would raise TypeError."""
    match node:
        case ast.Constant(value=str() | bytes()):
            return "text"
        case ast.Constant(value=bool() | None):
            return "flag"
        case ast.Lambda() | ast.GeneratorExp() | ast.JoinedStr() | ast.Dict() | ast.Compare():
            return None
    return "value"


def sites(source: bytes) -> list[Site]:
    """All places of a file where one change can be made."""
    finder = _Finder(source)
    finder.walk(ast.parse(source))
    return finder.found


def files(root: Path, paths: Iterable[str], without: Iterable[str] = ()) -> list[Path]:
    """The Python files of a room. Raises ValueError for a path that is not there."""
    left_out = [root / path for path in without]
    found: list[Path] = []
    for path in paths:
        here = root / path
        if not here.exists():
            raise ValueError(f"{path}: no such file or folder")
        found += [here] if here.is_file() else sorted(here.rglob("*.py"))
    return [p for p in found if not any(p.is_relative_to(other) for other in left_out)]


def mutants(root: Path, room: str, found: Iterable[Path], seed: int = SEED) -> list[Mutant]:
    """Every mutant of the files of a room, in the order of its draw, whatever its operator."""
    made, alike = [], Counter[str]()
    for path in found:
        where = path.relative_to(root).as_posix()
        within = Counter[tuple[str, str, str]]()
        for site in sites(path.read_bytes()):
            change = (site.operator, site.context, site.text)
            within[change] += 1
            text = "\0".join((str(seed), room, *change))
            alike[text] += 1
            name = hashlib.sha256(f"{text}\0{alike[text]}".encode()).hexdigest()[:12]
            made.append(
                Mutant(
                    name,
                    room,
                    site.operator,
                    where,
                    site.line,
                    site.first,
                    site.last,
                    site.start,
                    site.end,
                    site.text,
                )
            )
    return sorted(made)


def drawn(every: Iterable[Mutant], count: int) -> list[Mutant]:
    """So many mutants of a room: in turn one of each operator, at most one on a line."""
    queues: dict[str, list[Mutant]] = defaultdict(list)
    for mutant in every:  # in the order of names, which are hashes
        queues[mutant.operator].append(mutant)
    taken: list[Mutant] = []
    lines: set[tuple[str, int]] = set()
    order = sorted(queues, key=lambda operator: queues[operator][0].name)
    while len(taken) < count and any(queues.values()):
        for operator in order:
            queue = queues[operator]
            while queue and (queue[0].path, queue[0].line) in lines:
                queue.pop(0)
            if queue and len(taken) < count:
                lines.add((queue[0].path, queue[0].line))
                taken.append(queue.pop(0))
    return taken
