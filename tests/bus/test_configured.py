"""`--zenoh FILE`: the examples of docs/zenoh, who reads through them, and who does not."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import sys
from datetime import UTC, datetime, timedelta

import pytest

from gcs_tools import bus, result
from gcs_tools.recorded import OUT_OF_SIGHT
from tests.bus.configured import (
    EXAMPLES,
    HERE,
    PASSWORD,
    RATE_HZ,
    Authority,
    Stranger,
    Vehicle,
    example,
    free_port,
    of_stranger,
)
from tests.process.conftest import Program, claimed_instance, until

RUN = "r"
FOR_S = 1.5  # of flight that a tool records
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


def assert_whole(recorded):
    """Every tick, and nothing but the vehicle's."""
    assert recorded["ticks"] >= FOR_S * RATE_HZ
    assert recorded["lost"] == {}
    assert recorded["not_the_vehicles"] == 0


def test_through_a_router(publish, record, tmp_path):
    port = free_port()
    example("router.json5", port, tmp_path)
    command = re.search(r"python -c '(.*)'", (EXAMPLES / "router.json5").read_text())[1]
    router = subprocess.Popen(
        [sys.executable, "-c", command], cwd=tmp_path, stdin=subprocess.PIPE
    )  # fmt: skip
    try:
        client = example("router-client.json5", port, tmp_path)
        until(lambda: listens(port), "a router")
        publish(client)
        assert_whole(record(client))
    finally:
        router.kill()
        router.communicate()


def listens(port):
    with socket.socket() as probe:
        return probe.connect_ex((HERE, port)) == 0


STRANGERS = {
    "in the clear": ("tls", "tcp", None, None),
    "no certificate": ("tls", "tls", "nothing", None),
    "a certificate of others": ("tls", "tls", "theirs", None),
    "a name that no rule is for": ("tls", "tls", "other", None),
    "no password": ("password", "tls", "nothing", None),
    "a wrong password": ("password", "tls", "nothing", {"user": "gcs", "password": "guess"}),
    "a user that no rule is for": (
        "password", "tls", "nothing", {"user": "guest", "password": "welcome"},
    ),
}  # fmt: skip
LET_IN = {"a name that no rule is for", "a user that no rule is for"}


@pytest.mark.parametrize("who", STRANGERS)
def test_a_stranger_reads_and_writes_nothing(
    who, ours, theirs, secured, publish, record, stranger, tmp_path
):
    kind, protocol, certificate, user = STRANGERS[who]
    tls = {
        "theirs": {**theirs.tls("gcs"), "root_ca_certificate": str(ours.folder / "ca.pem")},
        "other": ours.tls("other"),
        "nothing": {"root_ca_certificate": str(ours.folder / "ca.pem")},
        None: None,
    }[certificate]
    port, vehicles, tools = secured(kind)
    publish(vehicles)
    trying = stranger(of_stranger(port, tmp_path, protocol, tls, user))
    assert_whole(record(tools))  # meanwhile, by who may
    came = trying.gave_up()
    assert came.pop("puts") > 100
    let_in = who in LET_IN
    assert came == {
        "refused": not let_in, "links": let_in, "ticks": 0, "tokens": 0, "answers": 0, "asked": 0
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["tls", "password"])
def test_a_tool_that_may_read_writes_nothing(
    kind, ours, secured, publish, record, stranger, tmp_path
):
    port, vehicles, tools = secured(kind)
    user = {"user": "gcs", "password": PASSWORD} if kind == "password" else None
    publish(vehicles)
    trying = stranger(of_stranger(port, tmp_path, "tls", ours.tls("gcs"), user))
    assert_whole(record(tools))
    came = trying.gave_up()
    assert came["links"] and not came["refused"]
    assert came["ticks"] > 100 and came["tokens"] > 0 and came["answers"] > 0
    assert came["puts"] > 100 and came["asked"] == 0


@pytest.mark.parametrize("kind", ["tls", "password"])
@pytest.mark.parametrize("name", ["vehicle of others", "other name"])
def test_a_tool_refuses_who_is_not_its_vehicle(kind, name, ours, theirs, secured, gcs, vehicle):
    port, vehicles, tools = secured(kind)
    certificate = {
        "vehicle of others": f"{theirs.folder}/vehicle",
        "other name": f"{ours.folder}/other",
    }
    text = vehicles.read_text().replace(f"{ours.folder}/vehicle", certificate[name])
    vehicles.write_text(text)
    with bus.session(bus.for_publisher(vehicle, RUN, vehicles)):
        assert listens(port)
        program = gcs("record", "out.mcap", "--zenoh", tools)
        assert program.wait() == 3
        assert f"no connection to tls/{HERE}:{port}: " in program.text()


@pytest.mark.parametrize("who", ["gcs", "other"])
def test_nothing_written_reaches_a_publisher(who, ours, secured, stranger, tmp_path, vehicle):
    port, vehicles, tools = secured("tls")
    with bus.session(bus.for_publisher(vehicle, RUN, vehicles)) as publisher:
        puts = publisher.declare_subscriber("**", bus.channel())
        tokens = publisher.liveliness().declare_subscriber("**", bus.channel(), history=True)
        came = stranger(of_stranger(port, tmp_path, "tls", ours.tls(who))).gave_up()
        assert came["links"] and came["puts"] >= 300 and came["asked"] == 0
        answers = [*publisher.get("**", timeout=1.0)]
        asked = publisher.declare_queryable("question", bus.channel())
        with bus.session(bus.for_tool(vehicle, tools)) as tool:
            tool.get(f"m_mrac/{RUN}/question", handler=bus.channel())
            until(asked.try_recv, "a question of who may ask")
        assert (puts.try_recv(), tokens.try_recv(), answers) == (None, None, [])
        for each in (puts, tokens, asked):
            each.undeclare()


def heard(session, key):
    """A subscriber and a watcher of liveliness."""
    return (
        session.declare_subscriber(key, bus.channel()),
        session.liveliness().declare_subscriber(key, bus.channel(), history=True),
    )


def test_who_asks_for_more_than_is_allowed_gets_none_of_it(secured, publish, vehicle):
    _, vehicles, tools = secured("tls")
    publish(vehicles)
    with (
        bus.session(bus.for_tool(vehicle, tools)) as modest,
        bus.session(bus.for_tool(vehicle, tools)) as greedy,
    ):
        too_much = heard(greedy, "**")
        for channel in heard(modest, "m_mrac/**"):
            for _ in range(3):
                until(channel.try_recv, "what is allowed")
        assert [channel.try_recv() for channel in too_much] == [None, None]


def test_rules_see_whole_keys(secured, publish, vehicle):
    _, vehicles, tools = secured("tls")
    topic = f"m_mrac/{RUN}/{vehicle + 1}/plant/truth"
    rule = 'key_exprs: ["m_mrac/**"]'
    vehicles.write_text(vehicles.read_text().replace(rule, f'key_exprs: ["{topic}"]'))
    publish(vehicles)
    with bus.session(bus.for_tool(vehicle, tools)) as tool:
        neighbour = tool.declare_subscriber(topic.replace("truth", "timing"), bus.channel())
        allowed = tool.declare_subscriber(topic, bus.channel())
        for _ in range(3):
            until(allowed.try_recv, "the topic of the rule")
        assert neighbour.try_recv() is None


def test_a_link_ends_with_the_certificate(ours, secured, publish, gcs, record, tmp_path):
    port, vehicles, tools = secured("tls")
    publish(vehicles)
    ours.sign("gcs", file="brief", until=datetime.now(UTC) + timedelta(seconds=8))
    (tmp_path / "brief").mkdir()
    paths = {"certificates/gcs": "certificates/brief", "certificates/": f"{ours.folder}/"}
    brief = example("tls-tool.json5", port, tmp_path / "brief", paths)
    out = tmp_path / "brief.mcap"
    program = gcs("record", out, "--json", "--zenoh", brief)
    assert program.wait() == 0, program.text()  # of its own accord
    said = json.loads(program.out.read_text())
    assert said["ended"] == OUT_OF_SIGHT and said["ticks"] > 0
    assert_whole(record(tools))  # it is there, for who may read


def test_the_recipe_makes_certificates_that_do(gcs, vehicle, tmp_path):
    assert shutil.which("openssl"), (
        "the recipe is for OpenSSL: install it (Debian: apt install openssl)"
    )
    recipe = re.search(r"```sh\n(.*?)```", (EXAMPLES / "off-host.md").read_text(), re.DOTALL)[1]
    recipe = recipe.replace("192.0.2.10", HERE)
    subprocess.run(
        ["bash", "-euc", recipe], cwd=tmp_path, check=True, capture_output=True, timeout=60.0
    )
    port = free_port()
    vehicles = example("tls-vehicle.json5", port, tmp_path)
    tools = example("tls-tool.json5", port, tmp_path)
    # certificates are found from where a program is started
    at, elsewhere = {"folder": tmp_path}, tmp_path / "elsewhere"
    publisher = gcs("publish", "--instance", vehicle, "--zenoh", vehicles, folder=elsewhere)
    assert publisher.wait() == 2
    assert f"{elsewhere}/certificates/ca.pem: No such file" in publisher.text()
    gcs("publish", "--instance", vehicle, "--zenoh", vehicles, **at).says('"ready"')
    tool = gcs("record", "recipe.mcap", "--for", FOR_S, "--zenoh", tools, folder=tmp_path)
    assert tool.wait() == 0, tool.text()
    assert "every tick is in it" in tool.text()


MISTAKES = {
    "no such file": (None, "No such file or directory"),
    "not JSON5": ("{ mode: ", "line 1, column 9: expected"),
    "an unknown key": ('{\n  listening: "no"\n}', "line 2, column 3: unknown field `listening`"),
    "an unknown value": ('{ mode: "pear" }', "line 1, column 9: unknown variant `pear`"),
    "no endpoint": ('{ connect: { endpoints: ["nowhere"] } }', "Endpoints must be of the form"),
    "nobody": ("{}", "neither connect/endpoints nor listen/endpoints is set"),
    "no certificate": (
        '{ listen: { endpoints: ["tls/127.0.0.1:0"] },'
        ' transport: { link: { tls: { root_ca_certificate: "none.pem" } } } }',
        "transport/link/tls/root_ca_certificate: ",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_file_that_cannot_be_used_is_told_in_a_line(mistake, gcs, tmp_path):
    text, told = MISTAKES[mistake]
    path = tmp_path / "mistaken.json5"
    if text is not None:
        path.write_text(text)
    program = gcs("record", "out.mcap", "--zenoh", path)
    assert program.wait() == 2, program.text()
    said = program.text()
    assert said.count("\n") == 1 and f"Error: {path}: " in said and told in said


@pytest.mark.parametrize("command", ["publish", "topics"])
def test_every_tool_tells(command, gcs, tmp_path):
    program = gcs(command, "--zenoh", tmp_path / "none.json5")
    assert program.wait() == 2
    assert "none.json5: No such file or directory\n" in program.text()


@pytest.mark.parametrize("command", [("publish",), ("record", "out.mcap"), ("topics",)])
def test_nobody_to_connect_to_is_told_in_a_line(command, gcs, tmp_path):
    port = free_port()
    program = gcs(*command, "--zenoh", example("router-client.json5", port, tmp_path))
    assert program.wait() == 3
    said = program.text()
    assert said.count("\n") == 1
    assert f"no connection to tcp/{HERE}:{port}: nobody is there" in said


@pytest.mark.parametrize("name", ["gcs", "other"])
def test_who_waits_is_told_what_for(name, ours, theirs, secured, publish, gcs, tmp_path):
    port, vehicles, _ = secured("tls")
    publish(vehicles)
    whose = {"gcs": theirs, "other": ours}[name]
    told = {
        "gcs": "nobody is there, or one refuses the other",
        "other": "connected, but no vehicle answers, or not to us",
    }
    file = of_stranger(port, tmp_path, "tls", whose.tls(name))
    gcs("record", "out.mcap", "--zenoh", file).says(f"waiting, as {file} says: {told[name]}")


@pytest.mark.parametrize("why", ["not a Zenoh configuration", "no connection to tcp/127.0.0.1:9"])
def test_a_flight_does_without(why, gcs, tmp_path):
    path = tmp_path / "bad.json5"
    nobody = '{ mode: "client", connect: { endpoints: ["tcp/127.0.0.1:9"] } }'
    path.write_text(nobody if "9" in why else "{ mode: ")
    with claimed_instance() as number:
        program = gcs(
            "fly", "paper_nominal", "--set", "flight.duration_s=1", "--out", tmp_path / "run",
            "--instance", number, "--zenoh", path,
        )  # fmt: skip
        program.wait(180.0)  # with a cold compile
    note = f"flown without diagnostics: {why if '9' in why else f'{path}: {why}'}"
    said = "".join(program.text().split())  # its lines are as wide as a terminal
    assert "".join(note.split()) in said
    flown = result.read(tmp_path / "run" / "result.json")
    assert (flown.ended, flown.error) == ("time", None)


def test_what_a_file_leaves_unsaid_is_as_without_one(tmp_path):
    path = tmp_path / "some.json5"
    path.write_text("""{
        connect: { endpoints: ["tcp/127.0.0.1:9"] }, namespace: "mine",
        transport: { unicast: { max_sessions: 3 } },
    }""")
    ours, config = bus.for_tool(0), bus.for_tool(0, path)
    assert config.get_json("connect/endpoints") == '["tcp/127.0.0.1:9"]'
    assert config.get_json("transport/unicast/max_sessions") == "3"
    for key in (
        "listen/endpoints", "scouting/multicast/enabled", "scouting/gossip/enabled", "namespace",
        "connect/retry", "transport/shared_memory/enabled", "transport/link/tx/lease",
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
        "transport/link/rx/max_message_size",
    ):  # fmt: skip
        assert config.get_json(key) == ours.get_json(key)
    assert bus.for_publisher(0, RUN, path).get_json("namespace") == f'"m_mrac/{RUN}"'


def test_who_scouts_listens_as_zenoh_does(tmp_path):
    path = tmp_path / "scouting.json5"
    listening = {}
    for scouts in ("true", "false"):
        path.write_text(
            f"{{ connect: {{ endpoints: ['tcp/{HERE}:9'] }},"
            f" scouting: {{ multicast: {{ enabled: {scouts} }} }} }}"
        )
        listening[scouts] = json.loads(bus.for_tool(0, path).get_json("listen/endpoints"))
    assert listening["false"] == []
    assert listening["true"]["peer"] == ["tcp/[::]:0"]
