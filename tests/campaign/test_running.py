"""A campaign's flights are the same bytes whatever happens to who flies them."""

from __future__ import annotations

import random
from concurrent.futures import Future

import pyarrow
import pytest
from pyarrow import parquet

from gcs_tools.campaigns import store as stores
from gcs_tools.campaigns.batch import Row, fly_batch
from gcs_tools.campaigns.campaign_file import CampaignError
from gcs_tools.campaigns.running import Ending, RunningError, run
from gcs_tools.campaigns.store import MOST_PARTS, PARQUET, Refused, Store

HERE = {"numpy": "1", "bits": "a"}


class Fake:
    """Workers that fly at once, in another order, and may end after some batches."""

    def __init__(self, fly, workers: int = 3, ends_after: int | None = None, seed: int = 0) -> None:
        self._fly = fly
        self._workers = workers
        self._left = ends_after
        self._random = random.Random(seed)
        self._waiting: list = []
        self.flown: list[int] = []

    def submit(self, plan, batch):
        future: Future = Future()
        self._waiting.append((future, plan, batch))
        if len(self._waiting) >= self._workers:
            self._finish()
        return future

    def count(self) -> int:
        while self._waiting:  # nobody waits for ever
            self._finish()
        return self._workers

    def _finish(self) -> None:
        future, plan, batch = self._waiting.pop(self._random.randrange(len(self._waiting)))
        if self._left is not None:
            self._left -= 1
            if self._left < 0:
                future.set_exception(RunningError("the machine is gone"))
                return
        self.flown += [each.number for each in batch]
        future.set_result(self._fly(plan, batch))


def invented(_plan, batch):
    """Rows of flights that nobody flew: every one by its number alone."""
    return [
        Row(a.number, a.law, a.number, a.number % 7 != 0, "time", "", 0, 1.0, 500, f"{a.number:x}",
            {"setpoint_error_final_m": 0.1 * a.number})
        for a in batch
    ]  # fmt: skip


def finished(campaign, folder, workers) -> bytes:
    kept = Store(folder, campaign, HERE)
    ending = Ending.of(campaign, kept)
    run(campaign, kept, workers, ending)
    return kept.finish(ending.n).read_bytes()


def test_rows_do_not_depend_on_workers_or_order(make, tmp_path):
    campaign = make("flights = 300")
    one = finished(campaign, tmp_path / "one", Fake(invented, workers=1))
    many = finished(campaign, tmp_path / "many", Fake(invented, workers=9, seed=4))
    assert one == many


def test_what_was_flown_before_an_end_is_not_flown_again(make, tmp_path):
    campaign = make("flights = 300")
    whole = finished(campaign, tmp_path / "whole", Fake(invented))
    first = Fake(invented, ends_after=11)
    cut = Store(tmp_path / "cut", campaign, HERE)
    with pytest.raises(RunningError):
        run(campaign, cut, first, Ending.of(campaign, cut))
    there = Store(tmp_path / "cut", campaign, HERE)
    assert there.flown == len(first.flown) > 0
    second = Fake(invented, seed=8)
    assert finished(campaign, tmp_path / "cut", second) == whole
    assert sorted(first.flown + second.flown) == list(range(300))


def test_an_early_end_is_at_the_same_flight_for_all(make, tmp_path):
    campaign = make("flights = 2000", tail="[stop]\nwidth = 0.2\n")
    ends = set()
    for i, workers in enumerate((1, 5, 30)):
        kept = Store(tmp_path / str(i), campaign, HERE)
        ending = Ending.of(campaign, kept)
        run(campaign, kept, Fake(invented, workers, seed=i), ending)
        ends.add((ending.n, kept.finish(ending.n).read_bytes()))
    ((n, _),) = ends
    assert n in campaign.looks.at
    assert n < 2000


@pytest.mark.computes
def test_parts_are_joined_before_there_are_too_many(make, tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "PART_S", 0.0)
    campaign = make("flights = 6000")
    kept = Store(tmp_path / "out", campaign, HERE)
    most = 0

    def count(_at):
        nonlocal most
        most = max(most, len(list((tmp_path / "out" / "parts").iterdir())))

    ending = Ending.of(campaign, kept)
    run(campaign, kept, Fake(invented, workers=1), ending, count)
    assert MOST_PARTS // 2 < most <= MOST_PARTS + 1
    assert kept.finish(ending.n).read_bytes() == finished(
        campaign, tmp_path / "two", Fake(invented)
    )


def test_a_part_that_was_joined_and_not_yet_removed_counts_once(make, tmp_path):
    campaign = make("flights = 40")
    whole = finished(campaign, tmp_path / "one", Fake(invented))
    kept = Store(tmp_path / "two", campaign, HERE)
    ending = Ending.of(campaign, kept)
    run(campaign, kept, Fake(invented), ending)
    (part,) = (tmp_path / "two" / "parts").iterdir()
    again = part.name.replace("00000000-", "00000007-")
    part.with_name(again).write_bytes(part.read_bytes())
    assert kept.finish(ending.n).read_bytes() == whole


def test_a_folder_of_another_campaign_or_of_other_versions_is_refused(make, tmp_path):
    Store(tmp_path / "out", make(), HERE)
    with pytest.raises(Refused, match="another campaign"):
        Store(tmp_path / "out", make("seed = 2"), HERE)
    with pytest.raises(Refused, match="began with bits a \\(here b\\)"):
        Store(tmp_path / "out", make(), {**HERE, "bits": "b"})
    Store(tmp_path / "out", make('title = "Another title."'), HERE)  # of which nothing depends
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("dear")
    with pytest.raises(Refused, match="not empty"):
        Store(tmp_path / "full", make(), HERE)


def test_flights_of_another_campaign_are_not_taken_for_its_own(make, tmp_path):
    campaign = make("flights = 40")
    finished(campaign, tmp_path / "one", Fake(invented))
    finished(make("flights = 40\nseed = 2"), tmp_path / "two", Fake(invented))
    (tmp_path / "one" / PARQUET).write_bytes((tmp_path / "two" / PARQUET).read_bytes())
    with pytest.raises(Refused, match="of another campaign"):
        Store(tmp_path / "one", campaign, HERE)
    with pytest.raises(Refused, match="of another campaign"):
        stores.row(campaign, tmp_path / "one", 1, "mmrac")


@pytest.mark.parametrize(
    "change",
    [{"number": None}, {"number": -5}, {"success": None}, {"exit_code": 99}, {"law": "px4"}],
)
def test_rows_that_no_flight_gives_are_refused(make, tmp_path, change):
    out = tmp_path / "out"
    campaign = make("flights = 8")
    finished(campaign, out, Fake(invented))
    table = parquet.read_table(out / PARQUET)
    rows = table.to_pylist()
    rows[3].update(change)
    parquet.write_table(pyarrow.Table.from_pylist(rows, table.schema), out / PARQUET)
    with pytest.raises(Refused, match="flight"):
        Store(out, campaign, HERE)


@pytest.mark.parametrize("left", [0, 3000])
def test_a_file_that_was_cut_is_said_to_whoever_reads_it(make, tmp_path, left):
    out = tmp_path / "out"
    campaign = make("flights = 40")
    finished(campaign, out, Fake(invented))
    path = out / PARQUET
    path.write_bytes(path.read_bytes()[:left])
    for read in (
        lambda: Store(out, campaign, HERE),
        lambda: stores.row(campaign, out, 1, "mmrac"),
    ):
        with pytest.raises(Refused, match="not flights of this campaign") as error:
            read()
        assert str(path) in str(error.value)


def test_damaged_files_of_a_campaign_are_refused(make, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    out = tmp_path / "out"
    campaign = make("flights = 40")
    whole = finished(campaign, out, Fake(invented))
    path = out / PARQUET
    middle = len(whole) // 3
    path.write_bytes(whole[:middle] + b"\xff" * 300 + whole[middle + 300 :])
    with pytest.raises(Refused, match="not flights of this campaign"):
        Store(out, campaign, HERE)
    path.write_bytes(whole)
    (out / stores.PARTS).mkdir()
    (out / stores.PARTS / "mine.parquet").write_bytes(whole)
    with pytest.raises(Refused, match="not a part of a campaign"):
        Store(out, campaign, HERE)
    (out / stores.PROPOSALS).write_text('{"0": 3}')
    with pytest.raises(CampaignError, match="proposals"):
        stores.reopened(out)


def test_a_campaign_that_was_changed_since_is_not_blamed_on_the_machine(
    make, folder, tmp_path, monkeypatch
):
    monkeypatch.chdir(folder)
    Store(tmp_path / "out", make(), HERE)
    assert stores.reopened(tmp_path / "out", unchanged=True).n == 20
    text = (tmp_path / "out" / stores.TOML).read_text()
    (tmp_path / "out" / stores.TOML).write_text(text.replace("1.2]", "1.3]"))
    with pytest.raises(CampaignError, match="has changed since it was flown"):
        stores.reopened(tmp_path / "out", unchanged=True)
    (tmp_path / "out" / stores.JSON).write_text("[" * 200_000)
    with pytest.raises(CampaignError, match="not a campaign's"):
        stores.reopened(tmp_path / "out")


def test_two_processes_do_not_fly_one_folder(tmp_path):
    with stores.locked(tmp_path), pytest.raises(Refused), stores.locked(tmp_path):
        pass


def test_a_full_disk_loses_nothing_that_was_written(make, tmp_path, monkeypatch):
    campaign = make("flights = 100")
    kept = Store(tmp_path / "out", campaign, HERE)
    whole = finished(campaign, tmp_path / "whole", Fake(invented))
    write, left = stores.whole_file.write, 3

    def full(path, data):
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(28, "No space left on device", str(path))
        write(path, data)

    monkeypatch.setattr(stores, "PART_S", 0.0)
    monkeypatch.setattr(stores.whole_file, "write", full)
    with pytest.raises(OSError, match="No space left"):
        run(campaign, kept, Fake(invented, workers=1), Ending.of(campaign, kept))
    monkeypatch.setattr(stores.whole_file, "write", write)
    assert Store(tmp_path / "out", campaign, HERE).flown == 72
    assert finished(campaign, tmp_path / "out", Fake(invented)) == whole


def test_a_law_alone_flies_the_vehicle_s_bits(make):
    alone, whole = make(), make('fly = "vehicle"')
    found = {}
    for campaign in (alone, whole):
        drawn = [campaign.draws.quantities(n) for n in range(3)]
        base = campaign.variants[0].base
        asked = [(n, 0, campaign.draws.values(n, each, base)) for n, each in enumerate(drawn)]
        rows = fly_batch(campaign.plan(), asked)
        found[campaign.document.fly] = rows
        assert all(row.trajectory_sha256 and not row.error for row in rows)
    assert found["law"] == found["vehicle"]
    assert len({row.trajectory_sha256 for row in found["law"]}) == 3


def test_values_that_do_not_go_together_are_a_flight_that_failed(make):
    campaign = make()
    (row,) = fly_batch(campaign.plan(), [(4, 0, {"plant.mass_kg": -1.0})])
    assert (row.ended, row.success, row.exit_code) == ("rejected", False, 2)
    assert "mass_kg" in row.error


def test_a_folder_without_a_campaign_is_said(tmp_path):
    with pytest.raises(CampaignError, match="No such file"):
        stores.reopened(tmp_path)
    (tmp_path / "campaign.json").write_text("{}")
    (tmp_path / "campaign.toml").write_text("")
    with pytest.raises(CampaignError, match="not a campaign's"):
        stores.reopened(tmp_path)
