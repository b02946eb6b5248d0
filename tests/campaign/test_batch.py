"""The flights of a batch: the same rows whatever flies them, and however much they share."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from gcs_tools.campaigns.batch import fly_batch
from gcs_tools.flight import law_flights
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, with_values
from tests.campaign.conftest import HOVER

FLIGHTS = 9
FOLLOW = """title = "Along a track."
[flight]
duration_s = 60.0
start = { on_ground = true }
items = [{ kind = "take_off", height_m = 5.0 }, { kind = "follow", file = "track.csv" }]
"""


@pytest.fixture
def drawn(make):
    """A plan, and its first flights: under two laws, some that crash or cannot fly."""
    campaign = make(
        'laws = ["mmrac", { law = "mmrac", label = "slow", set = { "law.f_m" = 0.8 } }]'
    )
    asked = []
    for n in range(FLIGHTS):
        quantities = campaign.draws.quantities(n)
        for law, variant in enumerate(campaign.variants):
            values = campaign.draws.values(n, quantities, variant.base)
            if n == 3:
                values = {**values, "flight.start.velocity_m_s": [0.0, 0.0, -60.0]}
            if n == 4:
                values = {**values, "plant.mass_kg": -1.0}
            if n > 6 and law == 0:
                values = {**values, "law.f_m": 0.9}
            asked.append((n, law, values))
    return campaign.plan(), asked


@pytest.mark.computes
def test_lanes_change_no_row(drawn, monkeypatch):
    plan, asked = drawn
    flown = []
    beside = law_flights._beside

    def counted(scenes, *rest):
        found = beside(scenes, *rest)
        flown.extend(found.values())
        return found

    monkeypatch.setattr(law_flights, "_beside", counted)
    few, many = ({**json.loads(plan), "flights": n} for n in (1, int(law_flights.REPAID)))
    monkeypatch.setattr(law_flights, "is_compiled", lambda *kind: False)
    one_by_one = fly_batch(json.dumps(few), asked)
    assert not flown
    in_lanes = fly_batch(json.dumps(many), asked)
    assert len(flown) >= len(asked) - 4
    assert in_lanes == one_by_one
    assert [(row.number, row.law) for row in in_lanes] == [each[:2] for each in asked]
    ended = [row.ended for row in in_lanes]
    assert ended.count("crashed") == 2
    assert ended.count("rejected") == 2
    assert ended.count("time") == len(asked) - 4


def test_what_is_worked_out_once_is_of_what_is_the_same_to_the_bit(tmp_path):
    (tmp_path / "hover.toml").write_text(HOVER)
    base = load(tmp_path / "hover.toml")

    def made(**values):
        return scenario(with_values(base, values, "draw"))

    at = "flight.setpoints"
    one, other = (made(**{at: [[0.0, x, 0.0, 0.0]]}) for x in (0.0, -0.0))
    again = made(**{at: [[0.0, 0.0, 0.0, 0.0]], "flight.seed": 2})
    assert one.setpoints.tobytes() != other.setpoints.tobytes()
    assert again.setpoints is one.setpoints
    assert again.settings is one.settings
    assert made(**{"law.f_m": 0.9}).settings != one.settings
    assert made(**{"flight.rate_hz": 250}).settings != one.settings
    assert replace(again, sent_at=one.sent_at).sent == one.sent


def test_a_track_that_is_read_is_the_one_that_is_flown(tmp_path):
    track, mission = tmp_path / "track.csv", tmp_path / "follow.toml"
    mission.write_text(FOLLOW)
    ends = []
    for x in (1.0, -8.0):
        rows = (f"{0.5 * i},{x * i / 40},0,5" for i in range(41))
        track.write_text("\n".join(["t_s,x_m,y_m,z_m", *rows]))
        ends.append(scenario(load(mission)).sent[-1].r_c.x)
    assert ends == pytest.approx([1.0, -8.0], abs=0.01)
