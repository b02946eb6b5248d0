"""A campaign's folder that was damaged, or that somebody else has made: nothing in it is believed unseen."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from gcs_tools.campaigns import refly
from gcs_tools.campaigns import store as stores
from gcs_tools.campaigns.campaign_file import CampaignError
from gcs_tools.campaigns.running import Ending, run
from gcs_tools.campaigns.store import PARQUET, PARTS, Refused, Store, locked
from tests.campaign.test_running import HERE, Fake, finished, invented

FLIPS = 300


def interrupted(campaign, out):
    """The part in a folder that an interruption has left."""
    kept = Store(out, campaign, HERE)
    run(campaign, kept, Fake(invented), Ending.of(campaign, kept))
    (part,) = (out / PARTS).iterdir()
    return part


@pytest.mark.computes
def test_a_flipped_bit_of_a_part_never_becomes_another_row(make, tmp_path):
    campaign, out = make("flights = 40"), tmp_path / "out"
    part = interrupted(campaign, out)
    data = bytearray(part.read_bytes())
    for bit in np.random.default_rng(1).integers(0, 8 * len(data), FLIPS).tolist():
        data[bit // 8] ^= 1 << bit % 8
        part.write_bytes(data)
        with pytest.raises(Refused, match="damaged"):
            Store(out, campaign, HERE)
        data[bit // 8] ^= 1 << bit % 8
    part.write_bytes(data)
    assert Store(out, campaign, HERE).flown == 40


@pytest.mark.computes
def test_a_flipped_bit_of_the_flights_is_refused_or_changes_no_row(make, tmp_path):
    campaign, out = make("flights = 40"), tmp_path / "out"
    whole = bytearray(finished(campaign, out, Fake(invented)))
    rows = stores._read(out / PARQUET, stores.schema(campaign)).to_pylist()
    refused = 0
    for bit in np.random.default_rng(2).integers(0, 8 * len(whole), FLIPS).tolist():
        whole[bit // 8] ^= 1 << bit % 8
        (out / PARQUET).write_bytes(whole)
        try:
            found = stores._read(out / PARQUET, stores.schema(campaign)).to_pylist()
            assert repr(found) == repr(rows)
        except Refused:
            refused += 1
        whole[bit // 8] ^= 1 << bit % 8
    assert refused > FLIPS // 3


@pytest.mark.parametrize("kind", [os.mkfifo, os.mkdir])
def test_flights_that_are_no_file_are_refused_without_waiting(make, tmp_path, kind):
    campaign, out = make("flights = 40"), tmp_path / "out"
    finished(campaign, out, Fake(invented))
    (out / PARQUET).unlink()
    kind(out / PARQUET)
    with pytest.raises(Refused, match=PARQUET):
        Store(out, campaign, HERE)
    (out / "campaign.toml").unlink()
    kind(out / "campaign.toml")
    with pytest.raises(CampaignError, match=r"campaign\.toml"):
        stores.reopened(out)


@pytest.mark.parametrize("name", ["../../../else", "/tmp/else", "a/b", "..", "", 3, None])
def test_the_name_of_a_campaign_leads_to_no_other_folder(make, folder, tmp_path, monkeypatch, name):
    monkeypatch.chdir(folder)
    out = tmp_path / "out"
    Store(out, make(), HERE)
    about = json.loads((out / "campaign.json").read_text())
    (out / "campaign.json").write_text(json.dumps({**about, "name": name}))
    with pytest.raises(CampaignError, match="name"):
        refly.numbered(f"{out}#3", "again")
    assert not (out / "again").exists()


@pytest.mark.parametrize("link", [".lock", "parts", "again"])
def test_a_link_is_not_followed(make, folder, tmp_path, monkeypatch, link):
    monkeypatch.chdir(folder)
    out, theirs = tmp_path / "out", tmp_path / "theirs"
    campaign = make()
    Store(out, campaign, HERE)
    theirs.mkdir()
    (theirs / "letter").write_text("dear")
    if link == PARTS:
        (out / PARTS).rmdir()
    (out / link).symlink_to(theirs / "letter" if link == ".lock" else theirs)
    use = {
        ".lock": lambda: locked(out).__enter__(),
        PARTS: lambda: Store(out, campaign, HERE),
        "again": lambda: refly.numbered(f"{out}#3", "again"),
    }
    with pytest.raises(CampaignError, match="link"):
        use[link]()
    assert [path.name for path in theirs.iterdir()] == ["letter"]
    assert (theirs / "letter").read_text() == "dear"


def test_the_file_of_the_flights_replaces_a_link(make, tmp_path):
    campaign, out = make("flights = 40"), tmp_path / "out"
    interrupted(campaign, out)
    kept = Store(out, campaign, HERE)
    (out / PARQUET).symlink_to(tmp_path / "nothing")
    kept.finish(40)
    assert not (out / PARQUET).is_symlink()
    assert not (tmp_path / "nothing").exists()
