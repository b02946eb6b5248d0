"""An import that is not allowed breaks the contract of its room, and every module is in a room."""

from __future__ import annotations

from copy import deepcopy

import grimp
import pytest

from tests.rooms.allow_list import AllowList, within
from tests.rooms.readme_imports import LINTER

CONTRACTS = {contract["name"]: contract for contract in LINTER["contracts"]}


@pytest.fixture(scope="module")
def imports():
    return grimp.build_graph(
        *LINTER["root_packages"], include_external_packages=True, cache_dir=None
    )


def check(options, graph):
    return AllowList(options["name"], {}, options).check(graph, verbose=False)


def of(room):
    return next(contract for contract in CONTRACTS.values() if room in contract["room"])


@pytest.mark.parametrize("name", CONTRACTS)
def test_every_contract_is_kept(imports, name):
    assert CONTRACTS[name]["type"] == "allow_list"
    assert not any(check(CONTRACTS[name], imports).metadata.values())


@pytest.mark.parametrize(
    ("room", "imported"),
    [
        ("fcu.kernel", "fcu.interface.messages"),
        ("fcu.interface", "fcu.mavlink"),
        ("fcu.mavlink", "socket"),
        ("fcu.laws", "click"),
        ("fcu.laws", "time"),
        ("fcu.laws", "numba"),  # through the kernel alone
        ("fcu.laws", "fcu.interface.link"),
        ("fcu.guard", "random"),
        ("fcu.vehicle", "socket"),
        ("fcu.vehicle", "fcu.services"),
        ("fcu.services", "pymavlink"),
        ("fcu", "fcu.theory"),
        ("fcu", "sitl_plant"),
        ("sitl_plant.physics", "fcu.laws"),
        ("sitl_plant", "fcu.vehicle"),
        ("sitl_plant", "gcs_tools"),
        ("gcs_tools.recording", "gcs_tools.flight"),
        ("gcs_tools.missions", "zenoh"),
        ("gcs_tools.live", "matplotlib"),
        ("gcs_tools", "sitl_plant.loop"),
    ],
)
def test_an_import_that_is_not_allowed_breaks_the_contract(imports, room, imported):
    graph, options = deepcopy(imports), of(room)
    importer = min(m for m in graph.modules if within(m, options["room"])
                   and not within(m, options.get("without", [])))  # fmt: skip
    graph.add_import(importer=importer, imported=imported)
    found = check(options, graph)
    assert not found.kept
    assert found.metadata["not allowed"] == [f"{importer} -> {imported}"]


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"also": ["fcu.kernel -> click"]}, "needed by no import"),
        ({"also": ["fcu.laws -> fcu.laws"]}, "needed by no import"),
        ({"room": ["fcu.kernel", "fcu.colonel"]}, "no such module"),
        ({"without": ["fcu.kernel.colonel"]}, "no such module"),
    ],
)
def test_a_contract_that_says_too_much_is_broken(imports, change, fault):
    found = check(of("fcu.kernel") | change, imports)
    assert [name for name, lines in found.metadata.items() if lines] == [fault]


def test_every_module_is_in_one_room(imports):
    rooms = [(c["room"], c.get("without", [])) for c in CONTRACTS.values()]
    ours = [m for m in imports.modules if within(m, LINTER["root_packages"])]
    assert ours
    for module in ours:
        assert sum(within(module, room) and not within(module, without)
                   for room, without in rooms) == 1, module  # fmt: skip
