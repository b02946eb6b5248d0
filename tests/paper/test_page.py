"""docs/paper.md and its figures: what it quotes is what is flown, what it names is there."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gcs_tools.studies.figures import __main__ as command
from gcs_tools.studies.figures import gamma, page
from gcs_tools.studies.figures.cases import CASES, Case, fly
from gcs_tools.studies.figures.drawing import FIGURES
from gcs_tools.studies.figures.numbers import QUANTITIES, gone_from, table, there_from

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "paper.md"
TEXT = PAGE.read_text(encoding="utf-8")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def flights():
    return {group: [fly(case) for case in cases] for group, cases in CASES.items()}


def same(quoted: str, measured: str) -> bool:
    """The same words, and numbers that differ by one unit of the last digit at most."""
    if NUMBER.sub("#", quoted) != NUMBER.sub("#", measured):
        return False
    pairs = zip(NUMBER.findall(quoted), NUMBER.findall(measured), strict=True)
    return all(
        len(a.partition(".")[2]) == len(b.partition(".")[2])
        and abs(float(a) - float(b)) <= 1.001 * 10.0 ** -len(a.partition(".")[2])
        for a, b in pairs
    )


@pytest.mark.parametrize(
    ("quoted", "is_same"),
    [("0.26 m", True), ("0.27 m", True), ("0.28 m", False), ("0.260 m", False), ("0.26 N", False), ("–", False)],
)  # fmt: skip
def test_what_counts_as_the_same_number(quoted, is_same):
    assert same(quoted, "0.26 m") == is_same


@pytest.fixture(scope="module")
def points():
    return [gamma.flown(case) for case in gamma.cases(gamma.QUOTED)]


@pytest.fixture(scope="module")
def hovers():
    return [gamma.hover(value) for value in gamma.QUOTED]


@pytest.mark.parametrize("group", [*CASES, gamma.NAME])
def test_the_page_quotes_what_is_flown(flights, points, hovers, group):
    rows = table(group, flights[group]) if group in CASES else gamma.table(points, hovers)
    quoted = page.tables(TEXT)[group].splitlines()
    measured = page.markdown(rows).splitlines()
    assert len(quoted) == len(measured)
    wrong = [(a, b) for a, b in zip(quoted, measured, strict=True) if not same(a, b)]
    assert not wrong, (
        "renew them: python -m gcs_tools.studies.figures --numbers --write docs/paper.md"
    )


def number(flights, group, title, key):
    flown = next(flown for flown in flights[group] if flown.case.title == title)
    return next(q for q in QUANTITIES[group] if q.key == key).of(flown)


@pytest.mark.parametrize("title", ["as printed", "with Δu", "with the guard"])
def test_at_f_m_1_thrust_and_tilt_are_inside_their_limits_after_a_second(flights, title):
    for which in ("thrust", "tilt"):
        assert number(flights, "nominal", title, f"{which}_at_limit_from_1_s_percent") == 0.0
    assert number(flights, "nominal", title, "reference_error_rms_settled_m") < 0.15


@pytest.mark.parametrize("title", ["as printed", "with Δu", "with the guard"])
def test_a_wrong_start_is_gone_within_5_s(flights, title):
    assert number(flights, "wrong_start", title, "reference_error_gone_s") < 5.0


def test_at_f_m_1_4_the_printed_law_saturates_for_good_and_the_repaired_one_does_not(flights):
    for which in ("thrust", "tilt"):
        key = f"{which}_at_limit_from_2_s_percent"
        assert number(flights, "fast", "as printed", key) > 99.0
        assert number(flights, "fast", "with Δu", key) == 0.0
    assert number(flights, "fast", "as printed", "ended").startswith("diverged")
    assert number(flights, "fast", "with Δu", "reference_error_final_m") < 0.05


@pytest.mark.parametrize("group", ["nominal", "fast"])
def test_with_the_guard_nothing_saturates_and_it_arrives(flights, group):
    for which in ("thrust", "tilt"):
        assert number(flights, group, "with the guard", f"{which}_at_limit_percent") == 0.0
    assert number(flights, group, "with the guard", "within_0_5_m_of_setpoint_s") < 10.0


def test_with_delta_u_the_prediction_error_falls_as_one_over_gamma(points):
    errors = {p.gamma: p.error for p in points if p.title == "with Δu"}
    assert set(errors) == set(gamma.QUOTED)
    for low, high in pairwise(gamma.QUOTED[1:]):
        assert errors[low] / errors[high] == pytest.approx(10.0, rel=0.05)
    printed = {p.gamma: p.error for p in points if p.title == "as printed"}
    assert printed[1e3] > 5.0 * errors[1e3]


def test_the_theorys_hover_keeps_inside_both_bounds(hovers):
    for sweep in hovers:
        assert sweep.measured < sweep.lyapunov
        assert np.isnan(sweep.inverse) or sweep.measured < sweep.inverse < sweep.lyapunov
    assert np.isfinite(hovers[-1].inverse)


def test_the_printed_flight_hangs_on_a_mass_far_too_low():
    flown = fly(Case("", "paper_printed"))
    assert not flown.ended
    assert flown.fcu["state.estimates.m_hat"][-1] < 2.0
    assert fly(Case("", "paper_printed", ("law.bounds.m_min=4.0",))).ended == "diverged"


def test_gone_and_there_are_for_good(flights):
    for flown in flights["wrong_start"]:
        for error, limit, found in (
            (flown.flight.reference_error, 0.05 * 5.0 * 3.0**0.5, gone_from(flown)),
            (flown.flight.setpoint_error, 0.5, there_from(flown)),
        ):
            first = int(np.searchsorted(flown.t, found - 1e-6))
            assert error[first - 1] >= limit > error[first:].max()


def test_a_diverged_flight_has_no_digits(flights):
    said = [row[2] for row in table("fast", flights["fast"]) if row[1].startswith("distance")]
    assert said == ["–"]


def test_the_page_shows_every_figure():
    assert (*FIGURES, gamma.NAME) == command.NAMES
    shown = re.findall(r"\]\(figures/([\w-]+)\.png\)", TEXT)
    assert sorted(shown) == sorted((*command.NAMES, "envelope_map"))  # that has its own command
    drawn = list((PAGE.parent / "figures").glob("*.png"))
    assert sum(path.stat().st_size for path in drawn) < 3e6


def test_no_line_begins_a_list_by_accident():
    assert not re.findall(r"^(?:\d+[.)]|[-+*]) ", TEXT, re.MULTILINE)


def test_a_test_that_the_page_names_is_there():
    there = {
        name
        for file in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)
    }
    named = set(re.findall(r"`(test_\w+)`", TEXT))
    assert named
    assert not named - there


# --- the command


def called(*arguments):
    return CliRunner().invoke(command.main, [str(word) for word in arguments])


def test_one_figure_is_drawn_the_same_each_time(tmp_path):
    done = [called("--only", "figure-9", "--out", tmp_path / name) for name in ("a", "b")]
    assert [d.exit_code for d in done] == [0, 0], done[0].output
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["figure-9.png"]
    first, second = ((tmp_path / name / "figure-9.png").read_bytes() for name in ("a", "b"))
    assert first.startswith(b"\x89PNG")
    assert first == second


def test_an_unknown_figure_is_told(tmp_path):
    done = called("--only", "figur-9", "--out", tmp_path / "figures")
    assert done.exit_code == 2
    assert "no figure 'figur-9' (did you mean figure-9?); there are figure-1" in done.output
    assert not (tmp_path / "figures").exists()


def test_numbers_go_into_a_page(tmp_path):
    copy = tmp_path / "paper.md"
    emptied = re.sub(r"(<!-- numbers of .*? -->\n).*?(<!-- end)", r"\1\2", TEXT, flags=re.DOTALL)
    copy.write_text(emptied, encoding="utf-8")
    assert copy.read_text(encoding="utf-8") != TEXT
    done = called("--numbers", "--write", copy)
    assert done.exit_code == 0, done.output
    assert "diverged after" in done.output
    assert same(copy.read_text(encoding="utf-8"), TEXT)


def test_a_page_without_the_marks_is_told(tmp_path):
    bare = tmp_path / "bare.md"
    bare.write_text("no tables\n")
    done = called("--numbers", "--write", bare)
    assert done.exit_code == 2
    assert "numbers of nominal" in done.output
    assert bare.read_text() == "no tables\n"


def test_numbers_for_machines(flights):
    whole = json.loads(called("--numbers", "--json").stdout)
    assert whole["gamma"]["with Δu"].keys() == {f"{g:g}" for g in gamma.QUOTED}
    found = whole["numbers"]
    assert found.keys() == CASES.keys()
    for group, cases in CASES.items():
        assert [*found[group]] == [case.title for case in cases]
        for flown in flights[group]:
            said = found[group][flown.case.title]
            assert said.pop("command") == flown.command
            assert said == {quantity.key: quantity.of(flown) for quantity in QUANTITIES[group]}


def test_json_goes_with_numbers():
    done = called("--json")
    assert done.exit_code == 2
    assert "--json and --write go with --numbers" in done.output
