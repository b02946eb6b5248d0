"""`--zenoh FILE`: what a file need not say, and how one that cannot be used is told."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess

import pytest

from gcs_tools.judging import result
from gcs_tools.live import bus
from gcs_tools.recording import reader as recording
from tests.bus.configured import (
    EXAMPLES,
    FOR_S,
    HERE,
    RUN,
    example,
    free_port,
    of_stranger,
)
from tests.patience import PATIENCE_S
from tests.process.conftest import claimed_instance


def test_the_recipe_makes_certificates_that_do(gcs, vehicle, tmp_path):
    assert shutil.which("openssl"), (
        "the recipe is for OpenSSL: install it (Debian: apt install openssl)"
    )
    recipe = re.search(r"```sh\n(.*?)```", (EXAMPLES / "off-host.md").read_text(), re.DOTALL)[1]
    recipe = recipe.replace("192.0.2.10", HERE)
    subprocess.run(
        ["bash", "-euc", recipe], cwd=tmp_path, check=True, capture_output=True, timeout=PATIENCE_S
    )
    port = free_port()
    vehicles = example("tls-vehicle.json5", port, tmp_path)
    tools = example("tls-tool.json5", port, tmp_path)
    # certificates are found from where a program is started
    at, elsewhere = {"folder": tmp_path}, tmp_path / "elsewhere"
    publisher = gcs("publish", "--instance", vehicle, "--zenoh", vehicles, folder=elsewhere)
    assert publisher.wait() == 2
    assert f"{elsewhere}/certificates/ca.pem: {os.strerror(errno.ENOENT)}" in publisher.text()
    gcs("publish", "--instance", vehicle, "--zenoh", vehicles, **at).says('"ready"')
    tool = gcs("record", "recipe.mcap", "--for", FOR_S, "--zenoh", tools, folder=tmp_path)
    assert tool.wait() == 0, tool.text()
    assert recording.read(tmp_path / "recipe.mcap").complete


MISTAKES = {
    "no such file": (None, os.strerror(errno.ENOENT)),
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
def test_every_tool_tells_of_a_bad_file(command, gcs, tmp_path):
    program = gcs(command, "--zenoh", tmp_path / "none.json5")
    assert program.wait() == 2
    assert f"none.json5: {os.strerror(errno.ENOENT)}\n" in program.text()


@pytest.mark.parametrize("command", [("publish",), ("record", "out.mcap"), ("topics",)])
def test_nobody_to_connect_to_is_told_in_a_line(command, gcs, tmp_path):
    port = free_port()
    program = gcs(*command, "--zenoh", example("router-client.json5", port, tmp_path))
    assert program.wait() == 3
    said = program.text()
    assert said.count("\n") == 1
    assert f" tcp/{HERE}:{port}: " in said


@pytest.mark.parametrize("name", ["gcs", "other"])
def test_a_wait_says_what_for(name, ours, theirs, secured, publish, gcs, tmp_path):
    port, vehicles, _ = secured("tls")
    publish(vehicles)
    whose = {"gcs": theirs, "other": ours}[name]
    told = {
        "gcs": "nobody is there, or one refuses the other",
        "other": "connected, but no vehicle answers, or not to us",
    }
    file = of_stranger(port, tmp_path, "tls", whose.tls(name))
    gcs("record", "out.mcap", "--zenoh", file).says(told[name])


NOBODY = '{ mode: "client", connect: { endpoints: ["tcp/127.0.0.1:9"] } }'


@pytest.mark.parametrize(
    ("text", "told"), [("{ mode: ", "bad.json5: "), (NOBODY, "tcp/127.0.0.1:9")]
)
def test_a_flight_does_without(text, told, gcs, tmp_path):
    path = tmp_path / "bad.json5"
    path.write_text(text)
    with claimed_instance() as number:
        program = gcs(
            "fly", "paper_nominal", "--set", "flight.duration_s=1", "--out", tmp_path / "run",
            "--figure", "never", "--instance", number, "--zenoh", path,
        )  # fmt: skip
        program.wait()
    said = "".join(program.text().split())  # its lines are as wide as a terminal
    assert told.strip() in said
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
        "transport/shared_memory/enabled", "transport/link/tx/lease",
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
        "transport/link/rx/max_message_size",
    ):  # fmt: skip
        assert config.get_json(key) == ours.get_json(key)
    most_ms = [json.loads(c.get_json("connect/retry"))["period_max_ms"] for c in (ours, config)]
    assert most_ms == [50, 500]  # whom one knocks at so often must be on this machine
    assert bus.for_publisher(0, RUN, path).get_json("namespace") == f'"m_mrac/{RUN}"'


def test_scouting_listens_as_zenoh_does(tmp_path):
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
