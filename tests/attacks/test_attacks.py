"""A few of each attack; `README.md` says how many there are when one of them is run by hand."""

from __future__ import annotations

import random

import pytest

from gcs_tools.cli.program import main as gcs
from tests.attacks import flood, generators, mutations, signals
from tests.attacks.outcome import MOST_BYTES, WITHIN_S, Outcome, Tally, run
from tests.process.conftest import instance

__all__ = ["instance"]

SEED, FEW = 1, range(16)
FINE = Outcome(("gcs",), 0, "there", 1000, 0.1, False)


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """Where attacks find their originals: a folder, and recordings."""
    mutations.load()
    folder = tmp_path_factory.mktemp("attacks")
    return folder, mutations.originals(folder)


@pytest.fixture
def tally():
    """What is wrong, in the end: nothing."""
    one = Tally()
    yield one
    assert not one.findings
    assert sum(one.codes.values()) > 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"said": "Traceback (most recent call last):"}, {"code": 1}, {"code": -11},
        {"memory": MOST_BYTES + 1}, {"worked_s": WITHIN_S + 1.0},
    ],
)  # fmt: skip
def test_what_is_looked_for_is_found(wrong):
    assert FINE.findings({0, 2}) == []
    assert len(FINE._replace(**wrong).findings({0, 2})) == 1


def test_a_copy_ends_as_the_program_does(tmp_path):
    done = run(["gcs", "fly", "no_such_mission"], tmp_path)
    assert (done.code, done.interrupted) == (2, False)
    assert "no_such_mission" in done.said
    assert done.memory > 10_000_000
    served = run(["fcu", "--instance", "99"], tmp_path)
    assert served.code == 2


def test_mutated_missions(begun, tally):
    mutations.attempts("missions", SEED, FEW, mutations.missions(begun[0], SEED), tally)


def test_mutated_recordings(begun, tally):
    attempt = mutations.recordings(*begun, SEED)
    mutations.attempts("recordings", SEED, FEW, attempt, tally)


def test_random_command_lines(begun, tally, instance):
    attempt = mutations.command_lines(*begun, SEED, instance)
    mutations.attempts("command lines", SEED, FEW, attempt, tally)


def test_every_message_with_random_fields(begun, tally, instance):
    assert mutations.messages(begun[0] / "messages", SEED, 1, tally, instance) > 200


def test_the_same_seed_gives_the_same():
    def drawn(seed):
        rng = random.Random(seed)
        texts = ["[flight]\nduration_s = 1.0\n"]
        return [
            *(generators.mission(rng, texts) for _ in range(20)),
            *(generators.flipped(rng, bytes(range(256))) for _ in range(20)),
            *(generators.command_line(rng, gcs, 9) for _ in range(20)),
        ]

    assert drawn(1) == drawn(1) != drawn(2)


@pytest.mark.parametrize(
    ("program", "victim", "name", "phase"),
    [
        ("fly", "publisher", "STOP", "flight"), ("fly", "fcu", "STOP", "handshake"),
        ("fly", "sitl_plant", "INT", "closing"), ("up", "runner", "KILL", "landing"),
        ("fly", "fcu", "PAUSE", "plan"), ("fly", "script", "KILL", "flight"),
        ("fly", "station", "KILL", "plan"),
    ],
)  # fmt: skip
def test_a_signal_ends_what_it_should_and_nothing_else(tmp_path, program, victim, name, phase):
    (trial,) = signals.trials([program], [victim], [name], [phase])
    assert signals.attempt(trial, tmp_path / "trial").findings == []


@pytest.mark.parametrize("authority", [False, True])
def test_a_flood_does_not_change_a_flight_in_lockstep(tmp_path, authority):
    one = flood.Flood(authority, 16, steers=False)
    # a rate that a busy machine answers too: `python -m tests.attacks.flood` sends ten times as many
    line, findings = flood.in_lockstep(one, 8.0, 2000.0, SEED, 50, tmp_path / "flooded")
    assert findings == [], line
