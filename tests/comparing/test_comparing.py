"""Laws side by side: each flight counts, the lost ones too, and the same comparison gives the same bytes."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from fcu.interface.files import whole_file
from gcs_tools.campaigns import comparing, gains_file, results
from gcs_tools.campaigns.comparing import Row
from gcs_tools.campaigns.procedure import read
from gcs_tools.campaigns.score import NAMES, Score, lost
from tests.command_line import gcs
from tests.patience import PATIENCE_S, until

OBJECTIVE = read().objective


def scored(error):
    return Score("", error, **dict.fromkeys(NAMES[1:], 0.5))


def rows(law, errors):
    return [
        Row("s1000", "hover", law, seed, lost("crashed") if error is None else scored(error))
        for seed, error in enumerate(errors, start=1)
    ]


def test_a_lost_flight_counts_as_lost_and_has_no_error():
    found = comparing.summary(rows("a", [0.1, 0.3, None, None]), OBJECTIVE)
    (cell,) = found.cells
    assert (cell.flights, cell.lost) == (4, 2)
    assert cell.means["error_m"].value == pytest.approx(0.2)
    (overall,) = found.overall
    assert overall.lost.value == 0.5
    assert overall.cost.value > 0.5 * OBJECTIVE.lost


def test_a_law_that_always_loses_has_no_mean():
    found = comparing.summary(rows("a", [None, None]), OBJECTIVE)
    assert math.isnan(found.cells[0].means["error_m"].value)
    assert found.overall[0].cost.value == OBJECTIVE.lost


def test_differences_are_of_seeds_with_which_neither_was_lost():
    both = [*rows("a", [0.1, 0.2, None, 0.4]), *rows("b", [0.15, None, 0.9, 0.45])]
    (difference,) = comparing.summary(both, OBJECTIVE).differences
    assert (difference.law, difference.first, difference.pairs) == ("b", "a", 2)
    assert difference.error_m.value == pytest.approx(0.05)
    assert difference.error_m.excludes_zero


def test_differences_of_cost_count_what_was_lost():
    both = [*rows("a", [0.1, 0.2, 0.3, 0.4]), *rows("b", [0.1, 0.2, 0.3, None])]
    found = comparing.summary(both, OBJECTIVE)
    (difference,) = found.differences
    assert (difference.pairs, difference.error_m.value) == (3, 0.0)
    fourth = OBJECTIVE.lost - comparing.cost(scored(0.4), OBJECTIVE)
    assert difference.cost.value == pytest.approx(fourth / 4)
    assert [each.cost_less_first.value for each in found.overall] == pytest.approx(
        [0.0, fourth / 4]
    )


def test_pairs_tell_apart_what_means_cannot():
    hard = [0.1 * seed for seed in range(1, 21)]  # seeds differ far more than laws
    both = [*rows("a", hard), *rows("b", [error + 0.01 for error in hard])]
    found = comparing.summary(both, OBJECTIVE)
    a, b = (cell.means["error_m"] for cell in found.cells)
    assert b.low < a.high
    assert found.differences[0].error_m.excludes_zero


@pytest.mark.slow
def test_a_comparison_writes_the_same_bytes_twice(tmp_path, cascade, hover):
    for name in ("one", "two"):
        done = gcs("compare", "mmrac", cascade, "--missions", hover, "--seeds", 3, "--out", tmp_path / name)  # fmt: skip
        assert done.exit_code == 0, done.output
    for file in (results.JSON, results.PARQUET, "results.png"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    found = json.loads((tmp_path / "one" / results.JSON).read_text())
    assert [(row["law"], row["seed"]) for row in found["flights"]] == [
        ("mmrac", 1), ("mmrac", 2), ("mmrac", 3),
        ("plain_cascade", 1), ("plain_cascade", 2), ("plain_cascade", 3),
    ]  # fmt: skip
    assert len({row["error_m"] for row in found["flights"]}) == 6
    assert not any(row["lost"] for row in found["flights"])
    assert found["laws"][1]["digest"]


@pytest.mark.slow
def test_parquet_holds_a_row_for_each_flight(tmp_path, cascade, hover):
    from pyarrow import parquet

    out = tmp_path / "out"
    done = gcs("compare", cascade, "--missions", hover, "--seeds", "0..2", "--out", out)
    assert done.exit_code == 0, done.output
    table = parquet.read_table(out / results.PARQUET)
    of_json = json.loads((out / results.JSON).read_text())
    assert table.to_pylist() == of_json["flights"]
    assert table.column("seed").to_pylist() == [0, 1, 2]
    about = json.loads(table.schema.metadata[b"m-mrac"])
    assert about["procedure_sha256"] == of_json["procedure_sha256"] == read().sha256
    assert about["seeds"] == [0, 1, 2]


@pytest.mark.slow
def test_a_vehicle_too_heavy_for_its_rotors_is_lost_and_counted(tmp_path, cascade, hover):
    done = gcs("compare", "mmrac", cascade, "--missions", hover, "--seeds", 2, "--set", "plant.mass_kg=40",
               "--set", "flight.duration_s=6", "--json")  # fmt: skip
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert [row["why_lost"] for row in found["flights"]] == ["crashed"] * 4
    assert all(row["error_m"] is None for row in found["flights"])
    assert [each["lost"]["value"] for each in found["overall"]] == [1.0, 1.0]
    assert found["differences"][0]["pairs"] == 0


@pytest.mark.slow
def test_gains_that_no_vehicle_arms_with_are_lost_and_told(cascade, hover):
    done = gcs("compare", "mmrac", cascade, "--missions", hover, "--seeds", 1, "--json",
               "--set", "law.rotor_response_s=1.0", "--set", "law.allocation=plain")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert [row["why_lost"] for row in json.loads(done.stdout)["flights"]] == ["refused", ""]
    said = " ".join(done.stderr.split())
    assert "mmrac on s1000: " in said and "[law] unstable_gains" in said
    assert "a vehicle refuses these gains" in said
    assert "rotor_response_s = 1.0 (--set)" in said


@pytest.mark.slow
def test_margins_are_found_where_the_vehicle_is_lost(cascade, hover, short):
    done = gcs("compare", cascade, "--missions", hover, "--seeds", 1, "--margins", "--procedure", short, "--json")  # fmt: skip
    assert done.exit_code == 0, done.output
    found = {each["quantity"]: each for each in json.loads(done.stdout)["margins"]}
    assert set(found) == {"delay", "lag", "mass", "wind"}
    mass = found["mass"]
    assert 8.0 < mass["held"] < mass["lost"] < 200.0 / 9.81  # of 200 N
    assert mass["lost"] <= 1.06 * mass["held"]
    for quantity, key, size in (("mass", "plant.mass_kg", 1.3), ("delay", "plant.delay_s", 1.5)):
        value = size * found[quantity]["lost"]
        beyond = gcs("compare", cascade, "--missions", hover, "--seeds", "0..0", "--set", f"{key}={value}",
                     "--set", "flight.duration_s=8", "--json")  # fmt: skip
        assert json.loads(beyond.stdout)["flights"][0]["lost"]


@pytest.mark.slow
def test_gains_are_flown_and_told(tmp_path, cascade, hover, short):
    file = tmp_path / "gains" / "cascade.toml"
    file.parent.mkdir()
    done = gcs("tune", cascade, "--procedure", short, "--out", file)
    assert done.exit_code == 0, done.output
    assert "cost in validation" in done.stdout
    told = [
        json.loads(gcs("compare", cascade, "--missions", hover, "--seeds", 2, "--json", *more).stdout)
        for more in ((), ("--gains", file.parent))
    ]  # fmt: skip
    plain, tuned = (each["overall"][0]["means"]["error_m"]["value"] for each in told)
    assert tuned < plain
    assert told[0]["laws"][0]["provenance"] is None
    assert told[1]["laws"][0]["provenance"]["optimiser_seeds"] == [1, 2]
    other = (cascade, "--missions", hover, "--seeds", 1, "--gains", file.parent, "--set")
    done = gcs("compare", *other, "plant.mass_kg=8.0")
    told = "was tuned with no --set, and flies with plant.mass_kg=8.0"
    assert told in done.stderr.replace("\n", " ")
    again = gcs("compare", "mmrac", "--missions", hover, "--seeds", 1, "--gains", file.parent)
    assert again.exit_code == 0
    assert "mmrac on s1000: no gains" in again.stderr


RAISES = "    limits, v, angles = params.limits, measured.v_E, euler(matrix(measured.q_EB))\n"
ENDLESS = (RAISES, RAISES + "    while params.k_v > 3.3:\n        pass\n")


@pytest.mark.slow
def test_tuning_says_what_it_will_do_and_when_nothing_flew(tmp_path, cascade, short):
    out = tmp_path / "new" / "folder" / "gains.toml"
    heavy = ("--set", "plant.mass_kg=99.0")  # more than the rotors carry
    done = gcs("tune", cascade, "--procedure", short, "--out", out, *heavy)
    assert done.exit_code == 0
    assert "plain_cascade on s1000: 2 searches of 30 evaluations of 1 flight\n" in done.stderr
    assert "Every flight was lost" in done.stdout
    assert out.is_file()
    done = gcs("tune", cascade, "--procedure", short, "--out", tmp_path)
    assert (done.exit_code, "expected a file" in done.stderr) == (2, True)


@pytest.mark.computes
def test_a_law_that_raises_loses_that_flight_alone(tmp_path, cascade, hover):
    with open(cascade) as file:
        text = file.read()
    assert RAISES in text
    raises = RAISES + '    if measured.r_E.z > 0.1:\n        raise ValueError("too high")\n'
    (tmp_path / "raises.py").write_text(text.replace(RAISES, raises))
    low = tmp_path / "low.toml"
    low.write_text(hover.read_text().replace("0.2]", "0.0]").replace("A hover", "Low"))
    done = gcs(
        "compare", "px4", tmp_path / "raises.py", "--missions", f"{low},{hover}", "--seeds", "0..0",
        "--json", "--junit", tmp_path / "j.xml",
    )  # fmt: skip
    assert done.exit_code == 2
    blamed = {c.get("name") for c in ET.parse(tmp_path / "j.xml").iter("testcase") if len(c)}
    assert blamed == {"s1000-hover raises"}  # px4 has done nothing
    flights = json.loads(done.stdout)["flights"]
    found = {each["mission"]: each for each in flights if each["law"] == "raises"}
    assert found["low"]["why_lost"] == ""
    assert found["hover"]["why_lost"].startswith("raised: ")
    last = done.stderr.splitlines()[-1]
    assert all(part in last for part in ("raises in hover with seed 0", "1 of its 2 flights"))
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["compare", "mrac", "--missions", "benchmark"], "did you mean mmrac?"),
        (["compare", "mmrac", "--missions", "benchmark/step", "--out", "o"], "did you mean benchmark/steps?"),
        (["compare", "mmrac", "--missions", "square_and_land"], "flown by a whole vehicle"),
        (["compare", "mmrac", "--missions", "benchmark", "--seeds", "0"], "from one to"),
        (["compare", "mmrac", "--missions", "benchmark", "--seeds", "4..2"], "from one to"),
        (["compare", "mmrac", "--missions", "benchmark", "--seeds", "some"], "whole number"),
        (["compare", "mmrac", "--missions", "benchmark", "--airframe", "octo"], "no such airframe"),
        (["compare", "mmrac", "--missions", "benchmark", "--set", "law.fm=1"], "did you mean f_m?"),
        (["compare", "mmrac", "--missions", "benchmark", "--out", "/proc/none"], "/proc/none"),
        (["compare", "mmrac", "--missions", "benchmark", "--gains", "nowhere"], "nowhere"),
        (["compare", "mmrac", "--missions", "benchmark", "--procedure", "nowhere"], "nowhere"),
        (["compare", "mmrac", "--missions", "benchmark", "--figure", "a.gif"], "a.gif"),
        (["compare", "a", "b", "--seeds", "3"], "--seeds: laws are compared with --missions"),
        (["compare", "a", "b", "--gains", "c"], "--gains: laws are compared with --missions"),
        (["compare", "a"], "expected two runs or more, or laws and --missions"),
        (["tune", "mrac"], "did you mean mmrac?"),
        (["tune", "mmrac", "--airframe", "octo"], "no such airframe"),
        (["tune", "mmrac", "--out", "/proc/none.toml"], "/proc/none.toml"),
        (["tune", "mmrac", "--procedure", "nowhere"], "nowhere"),
        (["tune"], "Missing argument"),
    ],
)  # fmt: skip
@pytest.mark.computes
def test_a_command_line_that_cannot_be_done_is_refused(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = gcs(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr.replace("\n", " ")
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[law]\nf_m = 2.0\n", "expected [law] and [provenance]"),
        ("law", "mmrac.toml:1:"),
        ("[law]\n[provenance]\nlaw = 1\n", "expected texts for law"),
        (
            "[law]\n[provenance]\nlaw = 'a'\nlaw_digest = 'b'\nairframe = 'c'\nsince = 2020-01-01\n",
            "expected texts, numbers and lists",
        ),
    ],
)
def test_a_file_of_gains_that_is_none_is_refused(tmp_path, text, said):
    (tmp_path / "mmrac.toml").write_text(text)
    done = gcs("compare", "mmrac", "--missions", "benchmark", "--gains", tmp_path)
    assert done.exit_code == 2
    assert said in done.stderr.replace("\n", " ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("seeds = [1, 2, 3, 4, 5]", "seeds = []"), "[search] seeds"),
        (("multiples = [0.25, 4.0]", "multiples = [4.0, 0.25]"), "[search] multiples"),
        (("multiples = [0.25, 4.0]", "multiples = [2.0, 4.0]"), "[search] multiples"),
        (("lost = 8.0", "lost = -8.0"), "[objective] lost"),
        (("lost = 8.0", "loss = 8.0"), "[objective] lost"),
        (("factor = 1.5", "factor = 1.0"), "[margins] factor"),
    ],
)
def test_a_procedure_that_cannot_be_followed_is_refused(tmp_path, change, said):
    from gcs_tools.campaigns.procedure import SHIPPED

    text = SHIPPED.read_text()
    assert change[0] in text
    path = tmp_path / "procedure.toml"
    path.write_text(text.replace(*change))
    done = gcs("tune", "mmrac", "--procedure", path)
    assert done.exit_code == 2
    assert said in done.stderr


def never(path, *_):
    """As a full disk answers."""
    raise OSError(28, "No space left on device", str(path))


@pytest.mark.slow
def test_what_a_full_disk_takes_is_shown(tmp_path, cascade, hover, short, monkeypatch):
    out = tmp_path / "new" / "gains.toml"
    monkeypatch.setattr("fcu.interface.files.whole_file.write", never)
    done = gcs("tune", cascade, "--procedure", short, "--out", out)
    assert done.exit_code == 2
    assert f"{out}: No space left on device" in done.stderr.replace("\n", "")
    assert gains_file_of(done.stdout, tmp_path).law == cascade
    monkeypatch.undo()
    write = whole_file.write

    def full_in_the_end(path, *what, **how):
        return never(path) if path.name == results.JSON else write(path, *what, **how)

    monkeypatch.setattr("fcu.interface.files.whole_file.write", full_in_the_end)
    done = gcs("compare", cascade, "--missions", hover, "--seeds", 2, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "No space left on device" in done.stderr
    assert "all missions" in done.stdout


def gains_file_of(text, folder):
    (folder / "shown.toml").write_text(text)
    return gains_file.read(folder / "shown.toml")


@pytest.mark.slow
def test_a_link_to_a_file_of_gains_stays_one(tmp_path, cascade, short):
    link, target = tmp_path / "link.toml", tmp_path / "gains.toml"
    link.symlink_to(target)
    assert gcs("tune", cascade, "--procedure", short, "--out", link).exit_code == 0
    assert link.is_symlink()
    assert gains_file.read(target).law == cascade


def children(pid):
    """The processes that one has started, by their ids."""
    return [*map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]


def cpu_s(pid):
    """Of a process, s."""
    spent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11]
    return int(spent) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
def test_a_law_that_goes_round_and_round_is_left(tmp_path, cascade, short):
    """The defaults fly; what the search tries next never ends."""
    law = tmp_path / "endless.py"
    text = Path(cascade).read_text()
    assert ENDLESS[0] in text
    law.write_text(text.replace(*ENDLESS))
    command = [sys.executable, "-m", "gcs_tools", "tune", str(law), "--procedure", str(short)]
    with Popen(command, cwd=tmp_path, stderr=PIPE, text=True, start_new_session=True) as tune:
        try:
            lines = iter(tune.stderr.readline, "")
            assert any("2 searches" in line for line in lines)
            copy = until(lambda: children(tune.pid), "the copy that its guardian waits for")[0]
            busy = cpu_s(copy) + 2.0
            until(lambda: cpu_s(copy) > busy, "the law goes round")
            tune.send_signal(signal.SIGINT)
            assert tune.wait(PATIENCE_S) == 130
        finally:
            if tune.poll() is None:
                tune.kill()
    assert not list(tmp_path.glob("*-s1000.toml"))
