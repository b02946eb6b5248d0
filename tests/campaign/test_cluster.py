"""Flights on the workers of a Dask scheduler: the same bytes, whoever of them is left."""

from __future__ import annotations

import os
import signal
import warnings
from contextlib import contextmanager

import pytest

from gcs_tools.campaigns.cluster import cluster
from gcs_tools.campaigns.fingerprint import fingerprint
from gcs_tools.campaigns.running import Ending, RunningError, processes, run
from gcs_tools.campaigns.store import Store
from tests.patience import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("default"),  # Dask's own
]


@contextmanager
def local(workers: int):
    """A scheduler and workers, each a process; a worker that is killed is started anew."""
    import distributed  # a second, which the others of this folder need not

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
            memory_limit=None,
        ) as there:  # fmt: skip
            yield there


def finished(campaign, folder, workers, told=lambda at: None) -> bytes:
    kept = Store(folder, campaign, {})
    ending = Ending.of(campaign, kept)
    run(campaign, kept, workers, ending, told)
    return kept.finish(ending.n).read_bytes()


def test_a_worker_that_is_killed_changes_no_byte(make, tmp_path):
    campaign, said, killed = make("flights = 200"), [], []
    with processes(2) as here:
        expected = finished(campaign, tmp_path / "here", here)
    with (
        local(2) as there,
        cluster(there.scheduler_address, fingerprint(), 60.0, said.append) as crew,
    ):

        def gone():
            crew.count()
            return any("has gone" in text for text in said)

        def kill(at):
            if not killed:
                killed.append(next(iter(there.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)
                until(gone, "the worker that was killed has gone")

        until(lambda: crew.count() == 2, "two workers may fly")
        assert finished(campaign, tmp_path / "there", crew, kill) == expected
    assert killed


class Told(Exception):
    """What a campaign says, where nothing else is waited for."""


def test_a_worker_of_other_bits_is_refused_and_told(make, tmp_path):
    campaign, other = make(), {**fingerprint(), "bits": "0123"}

    def tell(text):
        raise Told(text)

    with (
        local(1) as there,
        cluster(there.scheduler_address, other, 60.0, tell) as crew,
        pytest.raises(Told, match=r"is refused: it has bits \w+ \(here 0123\)"),
    ):
        finished(campaign, tmp_path / "out", crew)
    assert Store(tmp_path / "out", campaign, {}).flown == 0


def test_without_a_worker_it_waits_no_longer_than_it_is_told(make, tmp_path):
    campaign = make()
    with (
        local(0) as there,
        cluster(there.scheduler_address, fingerprint(), 0.6, print) as crew,
        pytest.raises(RunningError, match=r"no worker that may fly for 0\.6 s"),
    ):
        finished(campaign, tmp_path / "out", crew)


def test_a_scheduler_that_is_lost_is_an_error_and_another_goes_on(make, tmp_path):
    campaign = make("flights = 120")
    with processes(2) as here:
        expected = finished(campaign, tmp_path / "here", here)
    with local(1) as there, cluster(there.scheduler_address, fingerprint(), 60.0, print) as crew:

        def lose(_at):
            there.scheduler.listeners[0].stop()
            there.sync(there.scheduler.close)

        with pytest.raises(RunningError, match="scheduler is lost"):
            finished(campaign, tmp_path / "out", crew, lose)
    assert 0 < Store(tmp_path / "out", campaign, {}).flown < 120
    with local(1) as there, cluster(there.scheduler_address, fingerprint(), 60.0, print) as crew:
        assert finished(campaign, tmp_path / "out", crew) == expected


def test_without_a_scheduler_it_says_so(monkeypatch):
    monkeypatch.setattr("gcs_tools.campaigns.cluster.CONNECT_S", 0.5)
    there = cluster("tcp://127.0.0.1:9", {}, 1.0, print)
    with pytest.raises(RunningError, match="no scheduler answers"):
        there.__enter__()
