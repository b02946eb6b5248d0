"""The contract type of pyproject.toml: what the modules of one room may import, and nothing else.

import-linter has lists of what is forbidden; what nobody thought of is then allowed.
"""

from __future__ import annotations

import sys

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class AllowList(Contract):
    """Modules of a room import each other, what `may_import` names, and what `also` adds for some.

    A name stands for a module and all below it, "stdlib" for the standard library. A line of
    `also` is "importer -> imported"; one that no import needs breaks the contract, so that none
    outlives its reason. `without`: modules that are rooms of their own.
    """

    room = fields.ListField(subfield=fields.StringField())
    without = fields.ListField(subfield=fields.StringField(), default=())
    may_import = fields.ListField(subfield=fields.StringField())
    also = fields.ListField(subfield=fields.StringField(), default=())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Look at direct imports alone: what an imported room imports is its own contract."""
        members = {m for m in graph.modules if within(m, self.room) and not within(m, self.without)}
        excess = {
            (member, imported)
            for member in members
            for imported in graph.find_modules_directly_imported_by(member)
            if imported not in members and not self._allows(imported)
        }
        needed: dict[str, set[tuple[str, str]]] = {
            line: {(a, b) for a, b in excess if within(a, [from_]) and within(b, [to])}
            for line in self.also
            for from_, to in [line.split(" -> ")]
        }
        faults = {
            "not allowed": sorted(" -> ".join(i) for i in excess.difference(*needed.values())),
            "needed by no import": [line for line, imports in needed.items() if not imports],
            "no such module": [m for m in (*self.room, *self.without) if m not in graph.modules],
        }
        return ContractCheck(kept=not any(faults.values()), metadata=faults)

    def _allows(self, module: str) -> bool:
        library = "stdlib" in self.may_import and module in sys.stdlib_module_names
        return library or module == "__future__" or within(module, self.may_import)

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print every line that breaks it, under what is wrong with it."""
        for wrong, lines in check.metadata.items():
            for line in lines:
                output.print_error(f"{wrong}: {line}", bold=False)


def within(module: str, rooms: list[str]) -> bool:
    """Whether a module is one of these, or below one."""
    return any(module == room or module.startswith(f"{room}.") for room in rooms)
