"""Random systems and the octocopter's loops against their bounds, in small; and the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from gcs_tools.studies.theory_check import check, octocopter, region_draws
from gcs_tools.studies.theory_check.__main__ import main
from gcs_tools.studies.theory_check.check import Excluded, Held, held
from gcs_tools.studies.theory_check.report import Findings


@pytest.mark.slow
def test_no_bound_is_exceeded_by_100_random_systems():
    findings, rng = Findings(), np.random.default_rng(7)
    batches = [(check.general_batch, 15, decade) for decade in (1, 2, 3, 4)]
    batches += [(check.linear_batch, 8, decade) for decade in (1, 2, 3, 4)]
    batches += [(check.region_batch, 6, decade) for decade in (3, 3, 4, 4)]
    for make, count, decade in batches:
        findings.add("random", make(rng, count, decade, 300))
    lines = {line.name: line for line in findings.lines()}
    least = {
        "prediction (14)": 92, "prediction, 1/gamma": 15, "control difference (30)": 15,
        "tracking": 15, "control inside the region (31)": 5,
    }  # fmt: skip
    assert set(lines) == set(least)
    for name, line in lines.items():
        assert line.held >= least[name]
        assert line.exceeded == 0
        assert 1.0 <= line.tightness["min"] < 15.0
    assert lines["control inside the region (31)"].projected >= 2


def test_a_campaign_goes_on_until_it_has_counted_enough(monkeypatch):
    asked = []

    def half(rng, count, decade, steps):
        asked.append(decade)
        return [held("b", 2.0, 1.0)] * (count // 2) + [Excluded("b", "why")] * (count - count // 2)

    monkeypatch.setattr(check, "BATCHES", (half,))
    found = [one for batch in check.random_systems(1, systems=20, batch=10) for one in batch]
    assert sum(isinstance(one, Held) for one in found) == 20
    assert asked == [1, 2, 3, 4]


@pytest.mark.slow
@pytest.mark.parametrize("loop", ["position", "rates"])
def test_the_octocopters_bounds_are_tight(law, loop):
    if loop == "position":
        found = list(octocopter.position(law(), 2000.0, 8.0, duration=5.0))
    else:
        found = list(octocopter.rates(law(), 2000.0, 0.3245, duration=5.0))
    findings = Findings()
    findings.add("octocopter", found)
    for line in findings.lines():
        assert line.held >= 5
        assert line.exceeded == 0
        assert line.tightness["median"] < 10.0


def test_a_bound_that_does_not_hold_is_counted():
    findings = Findings()
    findings.add("a", [held("b", 1.0, 0.5), held("b", 1.0, 1.1), Excluded("b", "why")])
    (line,) = findings.lines()
    assert (line.held, line.exceeded, line.excluded) == (2, 1, {"why": 1})
    assert findings.exceeded == 1
    assert line.tightness["min"] == pytest.approx(1.0 / 1.1)


def test_a_bound_that_is_cut_is_exceeded(monkeypatch):
    """The check can fail: halve what (14) says."""
    real = check.prediction_bound

    def halved(*of):
        bound = real(*of)
        return bound._replace(
            V_0=np.asarray(bound.V_0) * 1e-4, level=np.asarray(bound.level) * 1e-4
        )

    monkeypatch.setattr(check, "prediction_bound", halved)
    rng = np.random.default_rng(1)
    found = check.general_batch(rng, 10, 2, steps=300)
    assert any(one.exceeded for one in found if isinstance(one, Held))


@pytest.mark.computes
def test_a_d_hat_beyond_what_the_guarantee_says_is_exceeded(monkeypatch):
    """The check can fail: say a thousandth of |d_hat|, in a set that is as large as before."""
    real = check.region_guarantee

    def cut(drawn, i):
        found = real(drawn, i)
        return found._replace(d_hat=1e-3 * found.d_hat)

    monkeypatch.setattr(check, "region_guarantee", cut)
    monkeypatch.setattr(region_draws, "ROOM", 1e3)
    found = check.region_batch(np.random.default_rng(1), 5, 4, steps=300)
    held_ = [one for one in found if isinstance(one, Held)]
    assert held_ and all(one.exceeded for one in held_)


def test_the_command_prints_and_answers_by_its_exit_code(monkeypatch):
    good, loose = held("bound", 2.0, 1.0), held("bound", 50.0, 1.0)

    def run(random, loops, *options):
        monkeypatch.setattr(check, "random_systems", lambda *a, **k: iter([[random]]))
        monkeypatch.setattr(octocopter, "octocopter_loops", lambda *a, **k: iter([[loops]]))
        return CliRunner().invoke(main, options)

    result = run(good, good, "--json")
    assert result.exit_code == 0, result.output
    assert [line["held"] for line in json.loads(result.stdout)] == [1, 1]
    assert run(loose, good).exit_code == 0
    assert run(good, loose).exit_code == 1
    assert run(held("bound", 1.0, 2.0), good).exit_code == 1
    assert "octocopter: bound" in run(good, good).output
