"""Parameters: what may be set, what is refused and why, and that nothing else changes a bit."""

from __future__ import annotations

import math
import os
import struct
import tomllib
from pathlib import Path

import pytest

from fcu.interface.airframe import OCTO, believed, load
from fcu.interface.parameter import Parameter, ParameterError
from fcu.interface.status_texts import ROOM
from fcu.parameters import VEHICLE, Parameters, ParamsFileError, Refused, entries
from fcu.parameters_page import page
from fcu.process.settings import PARAMETERS, settings
from tests.laws.conftest import PAPER

LAW = entries(PARAMETERS, load(OCTO))


@pytest.fixture(scope="module")
def start():
    return settings(*believed(), 500.0, PAPER)


@pytest.fixture(scope="module")
def law(start):
    return start.law


@pytest.fixture
def params(start):
    return Parameters(start, 7)


def float32(value):
    """A number as a PARAM_SET carries it."""
    return struct.unpack("<f", struct.pack("<f", value))[0]


def refused(params, name, value, armed=False):
    before = {n: params[n] for n in params.names}, params.settings
    with pytest.raises(Refused) as refusal:
        params.set(name, value, armed)
    assert ({n: params[n] for n in params.names}, params.settings) == before  # nothing changed
    assert len(refusal.value.brief) <= ROOM
    return refusal.value.kind, str(refusal.value)


def test_every_parameter_can_be_sent_and_explained(params):
    assert list(params.names) == sorted(set(params.names))
    for i, name in enumerate(params.names):
        info = params.info(name)
        assert params.index(name) == i
        assert info.name == name and len(name.encode()) <= 16
        assert info.low <= params[name] <= info.high, name
        assert info.values is None or params[name] in info.values
        assert info.sentence and len(info.sentence) < 80
        assert float32(params[name]) == pytest.approx(params[name], rel=1e-7)
    assert (params["MAV_SYS_ID"], params["MAV_TYPE"], params["MR_RATE"]) == (7.0, 14.0, 500.0)


def test_defaults_of_the_law_are_those_of_its_table():
    params = Parameters(settings(*believed(), 500.0), 1)
    for name in LAW:
        assert params[name] == pytest.approx(params.info(name).default, rel=1e-6), name


def test_law_is_the_one_handed_over_until_one_of_its_parameters_is_set(params, law):
    assert params.law is law
    assert params.set("MPC_XY_CRUISE", 4.0, True)
    assert params.law is law
    assert params.set("MR_F_M", 1.5, True)
    assert params.law == law._replace(f_m=1.5)
    assert params.changed == ("MR_F_M",)


@pytest.mark.parametrize("name", [n for n in LAW if not LAW[n].row.read_only])
@pytest.mark.computes
def test_a_parameter_set_and_set_back_gives_the_same_law(params, start, name):
    """A tenth more, or the other of two: accepted while disarmed, and undone without a trace."""
    was, info = params[name], params.info(name)
    other = 1.0 - was if info.values else min(float32(was * 1.1) or 2.0**-8, info.high)
    assert params.set(name, other, False)
    assert params.settings != start
    assert params[name] == pytest.approx(other, rel=1e-7)
    assert LAW[name].get(params.settings) == pytest.approx(other, rel=1e-7)
    assert params.set(name, float32(was), False)
    assert params.settings is start


def test_what_noise_takes_follows_every_parameter_that_it_hangs_on(start):
    params = Parameters(start, 7)
    assert start.guard.noise_force == start.guard.noise_torque == 0.0
    assert params.set("MR_GRD_N_VEL", float32(0.002), True)
    first = params.guard
    assert min(first.noise_force, first.noise_top, first.noise_torque, first.noise_turning) > 0.0
    assert params.set("MR_GAMMA", 500.0, True)
    assert params.guard.noise_turning < 0.8 * first.noise_turning
    assert params.set("MR_GAMMA", 1000.0, True)
    assert params.guard == first
    assert params.set("MR_GRD_N_VEL", 0.0, True)
    assert params.settings is start


def test_a_delay_that_the_gains_do_not_stand_is_refused_with_one_that_they_do(start):
    params = Parameters(start, 7)
    with pytest.raises(Refused, match=r"height unstable with .*; 0\.0.* would do") as refused:
        params.set("MR_GRD_DELAY", float32(0.03), True)
    most = float(str(refused.value).split("; ")[1].split()[0])
    assert 0.0 < most < 0.03
    assert params.set("MR_GRD_DELAY", float32(most), True)
    with pytest.raises(Refused, match="MR_ROTOR_RESP"):
        params.set("MR_ROTOR_RESP", float32(0.004), True)


def test_gamma_takes_its_roots_and_multiples_along(params, law):
    assert params.set("MR_GAMMA", 4000.0, True)
    assert params.law.gamma == 4000.0
    assert params.law.lambda_v == params.law.lambda_w == math.sqrt(4000.0)
    assert params.law.gamma_Lambda == pytest.approx(4.0 * law.gamma_Lambda, rel=1e-15)
    assert params.changed == ("MR_GAMMA",)  # the multiples are what they were
    assert params.set("MR_G_LAM", float32(1e-3), True)
    assert params.law.gamma_Lambda == 4.0  # 4000 times 0.001, the decimal that was meant
    assert params.set("MR_GAMMA", 1000.0, True)
    assert params.law == law._replace(gamma_Lambda=1.0)


def test_fields_behind_a_parameter(params):
    for name, value in (
        ("MR_C_TILT", 9.0), ("MR_C_YAW", 8.0), ("MR_C_PQ", 30.0), ("MR_C_R", 25.0),
        ("MR_T_MIN", 8.0), ("MR_TILT_MAX", 30.0), ("MR_ROTOR_RESP", 0.02),
        ("MR_YAWRATE_MAX", 90.0),
    ):  # fmt: skip
        assert params.set(name, value, True)
    law = params.law
    assert tuple(law.c_angle) == (9.0, 9.0, 8.0)
    assert tuple(law.c_rate) == (30.0, 30.0, 25.0)
    assert (law.limits.T_min, law.rotors.f_min) == (8.0, 1.0)
    assert law.limits.phi_star == math.radians(30.0)
    assert law.yaw_rate_max == math.radians(90.0)
    assert law.rotors.kappa == pytest.approx(2.5, rel=1e-9)  # a lag of 0.05 s seen as 0.02 s


def test_an_equal_float32_changes_nothing(params):
    assert params["BAT_CRIT_THR"] == 0.07
    assert not params.set("BAT_CRIT_THR", float32(0.07), False)
    assert not params.set("MR_G_LAM", float32(5e-4), False)
    assert not params.set("MAV_TYPE", 14.0, False)  # read only, and so it is


def test_refusals_name_value_and_reason(params):
    out = "VALUE_OUT_OF_RANGE"
    assert refused(params, "NOPE", 1.0) == ("DOES_NOT_EXIST", "NOPE: no such parameter")
    assert refused(params, "MR_GAMMA", 0.0) == (out, "MR_GAMMA 0 refused: 1 to 1000000 1/s^2")
    for worse in (math.nan, math.inf, -math.inf, 3e38, 1e300):
        assert refused(params, "MR_GAMMA", worse)[0] == out
    assert refused(params, "COM_OBL_RC_ACT", 2.0) == (
        out, "COM_OBL_RC_ACT 2 refused: one of 0, 3, 4, 5, 6, 7",
    )  # fmt: skip
    kind, why = refused(params, "COM_FLTMODE1", 2.0)
    assert kind == "READ_ONLY" and "no receiver whose switch selects a mode" in why
    assert refused(params, "MR_PRED", 0.0, armed=True) == (
        "PERMISSION_DENIED", "MR_PRED can be set while disarmed only",
    )  # fmt: skip


FIXED = [row.parts[0].name for row in VEHICLE if row.parts and row.low == row.high]


def test_few_parameters_have_a_value_that_cannot_be_changed_and_each_says_why(params):
    assert 0 < len(FIXED) <= 15
    for name in FIXED:
        value = params[name]
        assert not params.set(name, value, False)  # accepted, and nothing has changed
        kind, why = refused(params, name, value + 1.0)
        assert kind == "READ_ONLY"
        assert why == f"{name} is read only: {params.info(name).sentence}"


def test_every_refusal_of_a_value_fits_a_statustext(params):
    for name in params.names:
        refused(params, name, -1.2345679e38)


def test_a_short_refusal_has_the_reason_and_what_would_do(params):
    with pytest.raises(Refused) as refusal:
        params.set("MR_C_TILT", 80.0, False)
    assert refusal.value.brief.startswith("MR_C_TILT refused: pitch unstable; ")
    assert refusal.value.brief.endswith(" would do")


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("MR_T_MAX", 0.04, "0.1 to 100000 N"),
        ("MR_M_MIN", 20.0, "MR_M_MIN 20 must be below MR_M_MAX 20 (set MR_M_MAX first)"),
        (
            "MR_GRD_M_MIN",
            9.1,
            "MR_GRD_M_MIN 9.1 must not be above MR_GRD_M_MAX 9 (set MR_GRD_M_MAX first)",
        ),
        (
            "MR_GRD_M_MAX",
            6.9,
            "MR_GRD_M_MIN 7 must not be above MR_GRD_M_MAX 6.9 (set MR_GRD_M_MIN first)",
        ),
        ("MR_J_MAX", 0.01, "MR_J_MIN 0.02 must be below MR_J_MAX 0.01"),
        ("MR_M_0", 0.5, "m_hat_0: expected a value in [1.0, 20.0] kg"),
        ("MR_M_MIN", 6.0, "m_hat_0: expected a value in [6.0, 20.0] kg"),
        ("MR_J_0", 3.0, "J_hat_0: expected a value in [0.02, 2.0] kg m^2"),
        ("BAT_LOW_THR", 0.06, "BAT_CRIT_THR 0.07 must be below BAT_LOW_THR 0.06"),
        ("BAT_EMERGEN_THR", 0.07, "BAT_EMERGEN_THR 0.07 must be below BAT_CRIT_THR 0.07"),
    ],
)
def test_limits_between_parameters(params, name, value, reason):
    kind, why = refused(params, name, value)
    assert kind == "VALUE_OUT_OF_RANGE"
    assert why.startswith(f"{name} {value:.9g} refused: ") and reason in why


def test_unstable_combinations_are_refused_with_a_value_that_would_do(params):
    kind, why = refused(params, "MR_C_TILT", 80.0)
    assert kind == "VALUE_OUT_OF_RANGE"
    assert why.startswith("MR_C_TILT 80 refused: pitch unstable with MR_C_PQ 20, MR_F_M 1; ")
    would = float(why.rsplit("; ")[1].split()[0])
    assert 20.0 < would < 30.0  # the limit is 24.8
    assert params.set("MR_C_TILT", would, True)
    refused(params, "MR_C_PQ", 4.0)  # which was stable beside MR_C_TILT 10


def test_a_start_that_is_unstable_may_be_mended(start):
    params = Parameters(start._replace(law=start.law._replace(f_m=8.0)), 1)
    assert params.set("MR_ZETA_M", 0.9, True)  # still is
    assert params.set("MR_F_M", 1.0, True)
    refused(params, "MR_F_M", 8.0)


def test_prediction_takes_the_guard_along_from_its_default(params, law):
    """The condition is for the achieved force: as printed there is nothing but a warning."""
    assert params["MR_GUARD"] == 1.0
    assert params.set("MR_PRED", 0.0, False)
    assert (params["MR_GUARD"], params.guard.policy) == (0.0, 0.0)
    assert "MR_GUARD" in params.changed
    for policy in (1.0, 2.0):
        kind, why = refused(params, "MR_GUARD", policy)
        assert kind == "VALUE_OUT_OF_RANGE" and "the condition is for what was achieved" in why
    assert params.set("MR_PRED", 1.0, False)
    assert params.law is law


def test_a_guard_that_refuses_stands_against_the_printed_prediction(params):
    assert params.set("MR_GUARD", 2.0, True)
    assert params.guard.policy == 2.0
    assert "guard: expected a value" in refused(params, "MR_PRED", 0.0)[1]
    assert params.set("MR_GUARD", 0.0, True)
    assert params.set("MR_PRED", 0.0, False)


def test_the_guard_may_know_the_mass(params):
    assert params.set("MR_GRD_M_MIN", 8.0, True)
    assert params.set("MR_GRD_M_MAX", 8.0, True)
    assert params.guard[1:3] == (8.0, 8.0)


def test_prediction_takes_its_default_bounds_along():
    params = Parameters(settings(*believed(), 500.0), 1)
    assert params.set("MR_S_V_MAX", 50.0, False)
    assert params.set("MR_PRED", 0.0, False)
    printed = settings(*believed(), 500.0, {"prediction": "demanded"}).law
    assert params.law == printed._replace(bounds=printed.bounds._replace(s_v_max=50.0))
    assert params["MR_M_MAX"] == 12.0
    assert {"MR_PRED", "MR_M_MAX", "MR_J_0"} <= set(params.changed)
    assert "MR_S_V_MAX" not in params.changed
    assert params.set("MR_PRED", 1.0, False)
    assert params["MR_M_MAX"] == 9.0 and params["MR_S_V_MAX"] == 50.0


def test_saved_and_read_again_is_the_same_to_the_bit(params, start, tmp_path):
    for name, value in (("MR_GAMMA", 1234.5), ("MR_G_LAM", 3e-4), ("RTL_RETURN_ALT", 33.3)):
        assert params.set(name, float32(value), False)
    file = tmp_path / "vehicle.toml"
    params.write(file)
    assert os.listdir(tmp_path) == ["vehicle.toml"]
    text = file.read_text()
    assert text == params.text()
    assert "MR_GAMMA = 1234.5  # 1/s^2: adaptation gain" in text
    assert set(tomllib.loads(text)) == {n for n in params.names if not params.info(n).row.read_only}

    again = Parameters(start, 7, file)
    assert again.law == params.law
    assert all(again[n] == params[n] for n in params.names)
    assert again.set("RTL_RETURN_ALT", 20.0, False)
    again.reset()
    assert again["RTL_RETURN_ALT"] == 33.3 and again.law == params.law


def test_a_file_of_the_start_values_leaves_the_law_alone(params, start, tmp_path):
    params.write(tmp_path / "p.toml")
    assert Parameters(start, 7, tmp_path / "p.toml").settings is start
    assert Parameters(start, 7, tmp_path / "none.toml").settings is start


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(params, tmp_path, monkeypatch):
    file = tmp_path / "p.toml"
    params.write(file, "OLD = 1\n")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        params.write(file)
    assert os.listdir(tmp_path) == ["p.toml"] and file.read_text() == "OLD = 1\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("MR_F_M = 1.0\nMR_GAMA = 5.0\n", "p.toml:2: MR_GAMA: no such parameter"),
        ("\n\nMR_GAMMA = 0.5", "p.toml:3: MR_GAMMA: expected 1 to 1000000 1/s^2, got 0.5"),
        ("MR_GAMMA = nan", "p.toml:1: MR_GAMMA: expected 1 to 1000000 1/s^2, got nan"),
        ("MR_GAMMA = true", "p.toml:1: MR_GAMMA: expected a number, 1 to 1000000"),
        ("MR_GAMMA = 'x'", "p.toml:1: MR_GAMMA: expected a number, 1 to 1000000"),
        ("MAV_TYPE = 2", "p.toml:1: MAV_TYPE: read only"),
        ("[MR_GAMMA]\nx = 1", "p.toml:1: MR_GAMMA: expected a number"),
        ("MR_GAMMA = ", "p.toml:1: Invalid value"),
        (
            "MR_M_MIN = 3.0\nMR_M_MAX = 2.0",
            "p.toml:2: MR_M_MAX 2 refused: MR_M_MIN 3 must be below MR_M_MAX 2",
        ),
        (
            "MR_F_M = 9.0",
            "p.toml:1: MR_F_M 9 refused: pitch unstable with MR_C_TILT 10, MR_C_PQ 20; ",
        ),
    ],
)
def test_a_file_that_cannot_be_flown(start, tmp_path, text, reason):
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(ParamsFileError) as error:
        Parameters(start, 1, tmp_path / "p.toml")
    assert reason in str(error.value)


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("MR_C_TILT = 20.0\nMPC_XY_CRUISE = 4.0\n# soft\nMR_C_PQ = 6.0\n", "4: MR_C_PQ 6"),
        ("MR_C_PQ = 6.0\nMPC_XY_CRUISE = 4.0\nMR_C_TILT = 20.0\n", "3: MR_C_TILT 20"),
        ("MR_C_PQ = 4.0\nMR_C_TILT = 2.0\nMR_F_M = 9.0\n", "3: MR_F_M 9"),
    ],
)
def test_an_unstable_file_says_with_which_line_it_became_so_and_by_which_rule(
    start, tmp_path, text, refused
):
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(ParamsFileError) as error:
        Parameters(start, 1, tmp_path / "p.toml")
    said = str(error.value)
    assert f"p.toml:{refused} refused: pitch unstable with " in said
    assert "stable in hover" in said and "Which gains go together" in said


def test_a_file_is_judged_as_a_whole(start, tmp_path):
    """What its second line makes unstable its third makes good."""
    text = "MR_C_PQ = 4.0\nMR_C_TILT = 16.0\nMR_F_M = 0.3\n"
    (tmp_path / "p.toml").write_text(text)
    assert Parameters(start, 1, tmp_path / "p.toml")["MR_C_TILT"] == 16.0
    (tmp_path / "p.toml").write_text(f"{text}BAT_LOW_THR = 0.06\n")
    with pytest.raises(ParamsFileError, match="4: BAT_LOW_THR"):
        Parameters(start, 1, tmp_path / "p.toml")


def test_the_page_in_docs_is_current():
    assert (Path(__file__).parents[2] / "docs" / "parameters.md").read_text() == page()


def test_a_value_a_hair_beyond_either_end_passes_with_slack_alone():
    row = Parameter("k", "", 2.0, 1.0, 3.0, "1/s", "a gain")
    for end in (1.0 - 1e-7, 3.0 + 1e-7):
        row.check((end,), slack=1e-6)
        with pytest.raises(ParameterError):
            row.check((end,))
