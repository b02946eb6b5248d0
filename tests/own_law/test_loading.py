"""A law is found, imported and compiled once; what is wrong with it is said."""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.parameter import ParameterError
from fcu.kernel.buffers import fields
from fcu.laws import loader, unguarded
from fcu.laws.face import Limits
from fcu.laws.loader import LawError
from fcu.parameters import Parameters
from fcu.process import settings, tick

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def _files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_a_second_start_compiles_nothing_and_a_change_is_noticed(one_tick, own_law, cache):
    first = one_tick(own_law)
    assert first["compiled"] > 0
    assert first["columns"][-6:] == [f"internals.{v}.{a}" for v in ("v_c", "tau_c") for a in "xyz"]
    assert not any(name.startswith("guard") for name in first["columns"])

    second = one_tick(own_law)
    assert second["compiled"] == 0
    assert second["row"] == pytest.approx(first["row"], abs=0.0, nan_ok=True)

    own_law.touch()
    assert one_tick(own_law)["compiled"] == 0  # it is the text that counts

    beside = own_law.with_name("yawing.py")
    beside.write_text("gentle = 0.4\n")
    third = one_tick(own_law)
    assert third["compiled"] > 0
    assert third["digest"] != second["digest"]


@pytest.mark.slow
def test_a_second_start_compiles_nothing_for_a_law_that_is_shipped(one_tick, cache):
    assert one_tick("px4")["compiled"] > 0
    assert one_tick("px4")["compiled"] == 0
    assert one_tick("mmrac")["compiled"] > 0
    assert one_tick("px4")["compiled"] == one_tick("mmrac")["compiled"] == 0


@pytest.mark.slow
def test_a_law_leaves_what_is_compiled_of_ours_as_it_is(one_tick, own_law, cache):
    one_tick(own_law)
    ours = min((cache / "m-mrac").iterdir(), key=lambda folder: len(folder.name))
    before = _files(ours)
    own_law.write_text(own_law.read_text() + "\n# another law\n")
    one_tick(own_law)
    assert _files(ours) == before


@pytest.mark.slow
def test_two_that_start_at_once_both_fly(one_tick, own_law):
    own_law.write_text(own_law.read_text() + "\n# new\n")
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(one_tick, [own_law, own_law])
    assert one["row"] == pytest.approx(other["row"], abs=0.0, nan_ok=True)
    assert one_tick(own_law)["compiled"] == 0


@pytest.mark.slow
def test_an_own_law_without_a_cache_is_compiled_every_time(one_tick, own_law, tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    assert one_tick(own_law, cache=in_the_way)["compiled"] > 0


@pytest.mark.parametrize("name", ["numpy", "tick", "plain-cascade"])
def test_a_file_is_called_as_it_likes(own_law, name):
    law = loader.load(own_law.rename(own_law.with_name(f"{name}.py")))
    assert law.name == name
    import numpy

    assert hasattr(numpy, "ndarray")


def test_laws_whose_helpers_have_one_name_do_not_meet(own_law, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "own.py").write_text(own_law.read_text())
    (other / "yawing.py").write_text("gentle = 0.5\n")
    assert loader.load(own_law).face.gentle == 0.2
    assert loader.load(other / "own.py").face.gentle == 0.5


def test_a_package_beside_it_is_of_the_law(own_law, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)  # which would tell of the text before
    (tmp_path / "shaping").mkdir()
    (tmp_path / "shaping" / "__init__.py").write_text("from .gains import gentle\n")
    (tmp_path / "shaping" / "gains.py").write_text("gentle = 0.3\n")
    text = own_law.read_text()
    own_law.write_text(text.replace("from yawing", "import shaping.gains\nfrom shaping"))
    law = loader.load(own_law)
    assert law.face.gentle == law.face.shaping.gains.gentle == 0.3
    (tmp_path / "shaping" / "gains.py").write_text("gentle = 0.6\n")
    assert loader.load(own_law).face.gentle == 0.6


@pytest.mark.parametrize(
    "line",
    [
        "from shaping import gains; gentle = gains.gentle",
        "from shaping.gains import gentle",
        "import shaping.gains as of_yaw; gentle = of_yaw.gentle",
        "import shaping, shaping.gains; gentle = shaping.gains.gentle",
        "gentle = (lambda: __import__('shaping.gains').gains.gentle)()",
        "from shaping import *; gentle = gains.gentle",
    ],
)
def test_every_way_to_import_a_module_beside_it_finds_that_of_the_law(own_law, tmp_path, line):
    (tmp_path / "shaping").mkdir()
    (tmp_path / "shaping" / "__init__.py").write_text(
        "import shaping.gains\nfrom shaping import gains\n"
    )
    (tmp_path / "shaping" / "gains.py").write_text("import math\n\ngentle = math.sqrt(0.09)\n")
    text = own_law.read_text()
    own_law.write_text(
        text.replace(
            "from yawing import gentle\n", f"{line}\nif False:\n    import shaping.gains\n"
        )
    )
    law = loader.load(own_law)
    assert law.face.gentle == 0.3
    assert "shaping" not in sys.modules


def test_a_law_in_a_checkout_flies_with_the_packages_beside_it(own_law):
    for package in ("fcu", "gcs_tools", "sitl_plant"):
        own_law.with_name(package).symlink_to(ROOT / package)
    own_law.write_text(own_law.read_text() + "\n# in a checkout\n")
    law = loader.load(own_law)
    inside = [name for name in sys.modules if name.startswith(law.package.partition(".")[0])]
    assert not [name for name in inside if name.endswith((".face", ".kernel", ".compile"))]
    assert law.face.Limits is Limits


def test_threads_that_load_a_law_at_once_have_one(own_law):
    own_law.write_text(own_law.read_text() + "\n# for threads\n")

    def load(_: int) -> tuple[loader.Law, object]:
        law = loader.load(own_law)
        return law, law.ticks.Tick

    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(load, range(8)))) == 1


def test_what_is_compiled_once_a_law_is_a_module_of_its_own(own_law):
    laws = [loader.load(name) for name in (*loader.SHIPPED, own_law)]
    assert loader.load().ticks is tick and loader.load().settings is settings
    for law in laws:
        assert fields(law.ticks.Tick)["state"] is law.face.State
        assert fields(law.settings.Settings)["law"] is law.face.Params
        assert fields(law.ticks.Tick)["guard"] is (law.guard or unguarded).GuardInternals
        assert law.ticks.Settings is law.settings.Settings
    assert len({law.ticks.Tick for law in laws}) == len({law.package for law in laws}) == len(laws)


def test_a_default_may_follow_from_what_was_chosen(own_law):
    own_law.write_text(
        own_law.read_text()
        + "\n\ndef printed(chosen, airframe):\n"
        + "    return {'k_v': 2.0} if 'k_r' in chosen else {}\n"
    )
    made = loader.load(own_law).settings
    _, tables = believed()
    assert made.settings(*believed(), 500.0).law.k_v == 3.0
    assert made.settings(*believed(), 500.0, {"k_r": 1.2}).law.k_v == 2.0
    assert made.printed({"k_r": 1.2}, tables) == {"k_v": 2.0}


def test_a_guard_says_what_it_has_to_know_of_its_law(own_law):
    _changed(own_law, "class Params(", 'GUARD = "fcu.guard.guard"\n\n\nclass Params(')
    _refused(own_law, "fcu.guard.guard needs Params.", "Params.gamma")


def _refused(path: Path, *said: str) -> None:
    with pytest.raises(LawError) as refused:
        loader.load(path)
    for part in said:
        assert part in str(refused.value)


def test_a_law_that_nobody_knows_is_refused():
    _refused("mmrak", "mmrac")
    _refused("nowhere.py", "nowhere.py")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("def step(", "def step)(", [":{line}:"]),
        ("from yawing", "from yawning", [":{line}:", "yawning"]),
        ("def step(", "def stride(", ["step", "@kernel"]),
        ("@kernel\ndef step", "def step", ["step", "@kernel"]),
        ("def step(state, ", "def step(", ["step", "state, params"]),
        ("class State(NamedTuple)", "class State", ["State", "NamedTuple"]),
        ("class Internals(", "class Inwards(", ["Internals", "NamedTuple"]),
        ("    h: float", "    hh: float", ["Params", "h: float"]),
        ("    limits: Limits\n", "    limits: float\n", ["Params", "limits: Limits"]),
        ("    v_dot: Vec3", "    v_dot: str", ["State", "v_dot"]),
        (
            "    limits, v, angles =",
            "    print(1.0); limits, v, angles =",
            ["{line}: step", "Internals"],
        ),
    ],
)
def test_a_law_without_the_face_of_one_is_refused(own_law, old, new, said):
    text = own_law.read_text()
    assert old in text
    own_law.write_text(text.replace(old, new, 1))
    line = next((n for n, row in enumerate(text.splitlines(), 1) if old in row), 0)
    _refused(own_law, "own.py", *(part.format(line=line) for part in said))


def test_what_goes_wrong_in_a_module_beside_it_is_told_with_its_line(own_law):
    beside = own_law.with_name("yawing.py")
    beside.write_text("\ngentle = 1 / 0\n")
    _refused(own_law, "yawing.py:2", "ZeroDivisionError")


def test_a_module_beside_it_must_not_be_called_as_an_installed_one(own_law):
    own_law.with_name("json.py").write_text("gentle = 0.2\n")
    own_law.write_text(own_law.read_text().replace("from yawing", "from json"))
    _refused(own_law, "json.py", "import json")


def _changed(own_law: Path, old: str, new: str) -> Path:
    text = own_law.read_text()
    assert old in text
    own_law.write_text(text.replace(old, new))
    return own_law


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"PC_K_R"', '"PC_GAIN_OF_POSITION"', "PC_GAIN_OF_POSITION"),
        ('"PC_K_R"', '"PC K R"', "PC K R"),
        ('"PC_K_R"', '"PC_K_V"', "PC_K_V"),
        ('Parameter("k_r"', 'Parameter("guard"', "guard"),
        ('Parameter("k_r"', 'Parameter("h"', "h is filled in"),
        ('Parameter("k_r"', 'Parameter("k_x"', "k_x"),
        ("1.0, 0.1, 5.0", "6.0, 0.1, 5.0", r"'k_r': its default is 6\.0: .* 0\.1 to 5"),
        ('"PC_K_R"', '("PC_K_R", "PC_K_V")', "'k_r': expected a name of MAVLink, or Parts"),
        ("PARAMETERS = (\n", 'PARAMETERS = (\n    "k_q",\n', "expected a Parameter"),
        ("1.0, 0.1, 5.0", "None, 0.1, 5.0", "expected a default"),
        ("1.0, 0.1, 5.0", "1.0, 5.0, 0.1", "expected a range"),
    ],
)
def test_a_table_that_nobody_could_use_is_refused(own_law, old, new, told):
    with pytest.raises(LawError, match=told) as caught:
        loader.load(_changed(own_law, old, new))
    assert str(own_law) in str(caught.value)


def test_a_name_that_the_vehicle_has_is_refused(own_law):
    law = loader.load(_changed(own_law, '"PC_K_R"', '"COM_DISARM_LAND"'))
    with pytest.raises(ParameterError, match="COM_DISARM_LAND"):
        Parameters(law.settings.settings(*believed(), 500.0), 1, flown=law)


def test_a_law_that_ends_the_program_is_refused(own_law):
    own_law.write_text("import sys\n\nsys.exit(0)\n")
    with pytest.raises(LawError, match="SystemExit"):
        loader.load(own_law)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "loop.py").symlink_to("loop.py")
    for name in ("pipe.py", "loop.py", "null\0.py"):
        with pytest.raises(LawError):
            loader.load(tmp_path / name)


def test_hover_is_taken_for_that_of_the_airframe(own_law):
    law = loader.load(own_law)
    _, tables = believed()
    pace = law.settings.pace(law.settings.settings(*believed(), 500.0), tables)
    assert pace.T_hover == pytest.approx(9.81 * np.mean(tables["vehicle"]["mass_kg"]))


def test_a_guard_that_lacks_something_is_refused(own_law):
    own_law.with_name("half.py").write_text("PARAMETERS = ()\n")
    with pytest.raises(LawError, match="half lacks GuardParams"):
        loader.load(
            _changed(own_law, "class Params(", "import half\n\nGUARD = half\n\n\nclass Params(")
        )


def test_what_a_users_own_check_raises_is_a_refusal(own_law):
    own_law.write_text(own_law.read_text() + "\n\ndef check(params):\n    return 1 / 0\n")
    law = loader.load(own_law)
    with pytest.raises(ParameterError, match="ZeroDivisionError"):
        law.settings.settings(*believed(), 500.0)


def test_a_row_of_a_vec3_is_told_what_it_lacks(own_law):
    text = own_law.read_text().replace("    J: float  #", "    J: Vec3  #")
    own_law.write_text(text)
    with pytest.raises(LawError, match=r"'J'.*axes=True"):
        loader.load(own_law)
    row = 'Parameter("J", "PC_INERTIA", 0.35, 0.01, 2.0, "kg m^2", "believed inertia"'
    assert row in text
    ruled = row.replace("0.35, 0.01", "None, 1e-4") + ", axes=True, rule=scales.inertia"
    text = "from fcu.laws import scales\n" + text.replace(row, ruled)
    own_law.write_text(text.replace("(params.J * params.k_rate)", "params.k_rate * params.J"))
    law = loader.load(own_law)
    airframe, tables = believed()
    told = law.settings.settings(airframe, tables, 500.0).law.J
    pairs = tables["vehicle"]["inertia_kg_m2"]
    assert tuple(told) == pytest.approx([np.mean(each) for each in pairs])
