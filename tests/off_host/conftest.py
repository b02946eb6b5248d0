"""Vehicles and tools with files of docs/zenoh, who may read through them, and who may not."""

from __future__ import annotations

import json

import pytest

from tests.bus.configured import (
    FOR_S,
    PASSWORD,
    RUN,
    Authority,
    Stranger,
    Vehicle,
    example,
    free_port,
)
from tests.process.conftest import Program, claimed_instance

USERS = f"gcs:{PASSWORD}\nguest:welcome\n"  # one that the rules name, and one that they do not


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    authority = Authority(tmp_path_factory.mktemp("ours") / "certificates")
    authority.sign("other")
    return authority


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("theirs") / "certificates")


@pytest.fixture
def gcs(tmp_path):
    """`gcs("record", ...)`: a tool that is gone when the test is over, in a folder of its own."""
    programs: list[Program] = []

    def begin(command, *arguments, folder=None, **options):
        own = folder or tmp_path / f"{len(programs)}-{command}"
        own.mkdir(exist_ok=True)
        programs.append(Program(own, "gcs_tools", command, *arguments, **options))
        return programs[-1]

    yield begin
    for program in programs:
        program.kill()


@pytest.fixture
def vehicle():
    """The instance of a vehicle that flies."""
    with claimed_instance() as number:
        flying = Vehicle(number)
        flying.start()
        yield number
        flying.land()


@pytest.fixture
def publish(gcs, vehicle):
    """`publish(file)`: a publisher of that vehicle, ready."""

    def begin(file):
        program = gcs("publish", "--instance", vehicle, "--run", RUN, "--zenoh", file)
        program.says('"ready"')
        return program

    return begin


@pytest.fixture
def record(gcs, tmp_path):
    """`record(file)`: what `gcs record` says when it has recorded FOR_S."""

    def begin(file, *how):
        out = tmp_path / f"{len(list(tmp_path.glob('*.mcap')))}.mcap"
        program = gcs("record", out, "--json", "--for", FOR_S, "--zenoh", file, *how)
        assert program.wait() == 0, program.text()
        return json.loads(program.out.read_text())

    return begin


@pytest.fixture
def stranger(vehicle):
    """`stranger(file)`: one who tries everything."""
    strangers: list[Stranger] = []

    def begin(file):
        strangers.append(Stranger(file, RUN, str(vehicle + 1)))
        return strangers[-1]

    yield begin
    for each in strangers:
        each.close()


@pytest.fixture
def secured(tmp_path, ours):
    """`secured("tls")`: port, vehicle's and tool's file of docs/zenoh."""

    def files(kind):
        port = free_port()
        users = tmp_path / "users.txt"
        users.write_text(USERS)
        paths = {"certificates/": f"{ours.folder}/"}
        named = paths | ({"password-users.txt": str(users)} if kind == "password" else {})
        return (
            port,
            example(f"{kind}-vehicle.json5", port, tmp_path, named),
            example(f"{kind}-tool.json5", port, tmp_path, paths),
        )

    return files
