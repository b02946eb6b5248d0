"""`--zenoh FILE`: the examples of docs/zenoh, who reads through them, and who does not."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from datetime import UTC, datetime, timedelta

import pytest

from gcs_tools.live import bus
from gcs_tools.live.recorder import OUT_OF_SIGHT
from tests.bus.configured import (
    EXAMPLES,
    FOR_S,
    HERE,
    PASSWORD,
    RATE_HZ,
    RUN,
    example,
    free_port,
    of_stranger,
)
from tests.patience import until


def assert_whole(recorded):
    """Every tick, and nothing but the vehicle's."""
    assert recorded["ticks"] >= FOR_S * RATE_HZ
    assert recorded["lost"] == {}
    assert recorded["not_the_vehicles"] == 0


def listens(port):
    with socket.socket() as probe:
        return probe.connect_ex((HERE, port)) == 0


def test_a_recording_through_a_router_is_whole(publish, record, tmp_path):
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
        assert f" tls/{HERE}:{port}: " in program.text()


@pytest.mark.parametrize("who", ["gcs", "other"])
def test_puts_of_a_stranger_reach_no_publisher(who, ours, secured, stranger, tmp_path, vehicle):
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


def test_a_subscription_to_more_than_is_allowed_gets_nothing(secured, publish, vehicle):
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
