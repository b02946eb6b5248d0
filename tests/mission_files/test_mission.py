"""Mission files: those that are shipped, every refusal with its line, changes, origins."""

import json
import re

import pytest

from fcu.process.settings import PARAMETERS
from gcs_tools.flight.run import prepared
from gcs_tools.flight.run_folder import UsageError
from gcs_tools.judging.expectations import OTHERS
from gcs_tools.judging.metrics import METRICS
from gcs_tools.missions import schema as mission_schema
from gcs_tools.missions.mission import MissionError, Value, folder, load, override, shipped
from gcs_tools.missions.tables import Expect, LawTable

SHIPPED = sorted(path.stem for path in folder().glob("*.toml"))
VALID = """title = "A hover."
[flight]
duration_s = 20.0
setpoints = [
    [0.0, 0.0, 0.0, 0.0],
    { at_s = 5.0, position_m = [1.0, 2.0, 3.0] },
]
[law]
f_m = 1.0
[wind]
steady_m_s = [1, 0, 0]
[plant]
rotor_loss = [{ rotor = 1, at_s = 3.0, effectiveness = 0.6 }]
[expect]
reference_error_max_m = 0.5
reference_error_rms_m = { limit = 0.1, from = 5.0 }
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a mission file; its name as messages show it."""
    monkeypatch.chdir(tmp_path)

    def write(text):
        (tmp_path / "x.toml").write_text(text, encoding="utf-8")
        return "x.toml"

    return write


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_mission_loads_by_name_and_names_its_schema(name):
    mission = load(name)
    assert mission.name == name
    assert mission.expectations()
    first = (folder() / f"{name}.toml").read_text(encoding="utf-8").splitlines()[0]
    assert first == f"#:schema {mission_schema.NAME}"


@pytest.mark.parametrize(
    ("flight", "arena_m"),
    [
        ('script = "true"', 1000.0),
        ('script = "true"\narena_m = 50.0', 50.0),
        ("setpoints = [[0.0, 0.0, 0.0, 0.0]]", 100.0),
    ],
)
def test_a_script_may_fly_farther(write, flight, arena_m):
    mission = load(write(f'title = "A flight."\n[flight]\nduration_s = 20.0\n{flight}\n'))
    assert mission.flight.arena_m == arena_m


def test_the_paper_s_missions_are_shipped():
    assert {
        "paper_nominal", "paper_fast", "paper_printed", "paper_printed_fast", "package_drop",
        "weak_rotor", "noisy_state", "figure_eight", "gust_step",
    } <= set(SHIPPED)  # fmt: skip


def test_a_valid_file_gives_typed_values(write):
    mission = load(write(VALID))
    assert mission.flight.rate_hz == 500
    assert [s.at_s for s in mission.flight.setpoints] == [0.0, 5.0]
    assert mission.wind.steady_m_s == (1.0, 0.0, 0.0)
    assert mission.plant.rotor_loss[0].effectiveness == 0.6
    assert mission.law.model_dump(exclude_none=True) == {"f_m": 1.0, "bounds": {}}
    assert mission.expectations() == {
        "reference_error_max_m": {"limit": 0.5},
        "reference_error_rms_m": {"limit": 0.1, "from": 5.0},
    }


REFUSED = [
    ("reference_error_max_m = 0.5", "margin_min_n = { limit = 0.0 }", 15,
     "[expect] margin_min_n.limit: expected at_least (this metric is a minimum: "),
    ("reference_error_max_m = 0.5", "reached = 0.0", 15,
     "[expect] reached: expected true, false, or a distance > 0 in m, got 0.0"),
    ("reference_error_max_m = 0.5", "limited = 1", 15, "[expect] limited: expected true or false, got 1"),
    ("reference_error_max_m", "position_max_m", 15,
     "[expect] position_max_m: this metric is called reference_error_max_m now"),
    ("reference_error_rms_m", "command_rms_m", 16,
     "[expect] command_rms_m: this metric is called setpoint_error_rms_m now"),
    ("[0.0, 0.0", "[-3, 0.0", 5, "[flight] setpoints[0].at_s: expected a number >= 0, got -3"),
    ("[0.0, 0.0", "[1.0, 0.0", 5, "[flight] setpoints[0].at_s: expected 0 (a flight begins"),
    ("[0.0, 0.0, 0.0", "[0.0, 0.0, 'a'", 5, 'setpoints[0].position_m[1]: expected a number, got "a"'),
    ("0.0, 0.0],", "0.0],", 5, "[flight] setpoints[0]: expected four numbers: at_s, x, y, z"),
    ("at_s = 5.0", "at_s = 0.0", 6, "[flight] setpoints[1].at_s: expected a time after 0, got 0.0"),
    ("at_s = 5.0", "at_s = 20", 6, "setpoints[1].at_s: expected a time before duration_s, 20"),
    ("at_s = 5.0, ", "", 6, "[flight] setpoints[1].at_s: is missing"),
    ("[1.0, 2.0, 3.0]", "[1.0, 2.0]", 6, "setpoints[1].position_m: expected 3 numbers, got [1.0, 2.0]"),
    ("[1.0, 2.0, 3.0]", "[1.0, 2.0, 3.0, 4.0]", 6, "position_m: expected 3 numbers"),
    ("[1.0, 2.0, 3.0]", "7", 6, "[flight] setpoints[1].position_m: expected an array, got 7"),
    ("duration_s", "duration", 3, "[flight] duration: no such key (did you mean duration_s?)"),
    ("20.0", "20.0\nrate_hz = 300", 4, "[flight] rate_hz: expected one of 100, 125"),
    ("20.0", "20.0\nrate_hz = 500.5", 4, "[flight] rate_hz: expected a whole number, got 500.5"),
    ("20.0", "20.0\nseed = -1", 4, "[flight] seed: expected a number >= 0, got -1"),
    ("20.0", "20.0\nstart = { on_ground = 1 }", 4, "[flight] start.on_ground: expected true or"),
    ("20.0", "20.0\nground_z_m = 1.0", 2, "[flight] start.position_m[2]: expected a height above"),
    ("20.0", "20.0\ncurve = { kind = 'circle' }", 4, "curve.kind: expected figure_eight, got circle"),
    ("20.0", "nan", 3, "[flight] duration_s: expected a finite number, got nan"),
    ("20.0", "true", 3, "[flight] duration_s: expected a number, got true"),
    ("20.0", "1e9", 3, "[flight] duration_s: expected a number <= 3600, got 1000000000.0"),
    ("f_m = 1.0", "f_m = 0", 9, "[law] f_m: expected a number >= 0.1, got 0"),
    ("f_m = 1.0", "guard_mass_kg = [9, 7]", 9, "guard_mass_kg: expected [least, most], as in [7, 9]"),
    ("f_m = 1.0", "guard_mass_kg = 8", 9, "guard_mass_kg: expected [least, most] in kg, two numbers from 0.01 to 10000 (to believe in one value: [8, 8]), got 8"),
    ("f_m = 1.0", "guard_mass_kg = [8]", 9, "in one value: [8, 8]), got [8]"),
    ("f_m = 1.0", "guard_mass_kg = [7, 8, 9]", 9, "from 0.01 to 10000, got [7, 8, 9]"),
    ("f_m = 1.0", "guard_mass_kg = [7, 80000]", 9, "guard_mass_kg[1]: expected a number <= 10000"),
    ("f_m = 1.0", "gama = 1.0", 9, "[law] gama: no such key (did you mean gamma?)"),
    ("f_m = 1.0", "bounds.m_mx = 1.0", 9, "[law] bounds.m_mx: no such key (did you mean m_max?)"),
    ("f_m = 1.0", "tilt_max_deg = 85", 9, "[law] tilt_max_deg: expected a number <= 79, got 85"),
    ("f_m = 1.0", "prediction = 'x'", 9, "prediction: expected achieved or demanded, got x"),
    ("[1, 0, 0]", "[1, 0, 0]\nstep_m_s = [1, 0, 0]", 10, "[wind] step_at_s: expected a time for"),
    ("rotor = 1,", "rotor = 9,", 13, "[plant] rotor_loss[0].rotor: expected a number <= 8, got 9"),
    ("reference_error_max_m", "reference_error_mx_m", 15, "no such key (did you mean reference_error_max_m?)"),
    ("= 0.5", "= 'a'", 15, "[expect] reference_error_max_m: expected a number, or a table"),
    ("limit = 0.1, ", "", 16, "[expect] reference_error_rms_m: expected either limit or at_least"),
    ("from = 5.0", "from = 5.0, to = 5.0", 16, "[expect] reference_error_rms_m.to: expected a time after"),
    ("from = 5.0", "form = 5.0", 16, "[expect] reference_error_rms_m.form: no such key (did you mean from?)"),
    ("[expect]", "ended = 'no'\n[expect]", 14, "[plant] ended: no such key"),
    ("[expect]", "[expct]", 14, "[expct]: no such key (did you mean expect?)"),
    ('"A hover."', '"a hover"', 1, "title: expected a sentence on one line"),
    ('"A hover."', '"A \\u001b[31mhover."', 1, "title: expected a sentence on one line"),
    ("[wind]", "[wind", 10, "Expected ']' at the end of a table declaration"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "said"), REFUSED, ids=[r[3] for r in REFUSED])
def test_a_refusal_says_line_key_and_what_was_expected(write, old, new, line, said):
    assert old in VALID
    name = write(VALID.replace(old, new, 1))
    with pytest.raises(MissionError) as refused:
        load(name)
    lines = str(refused.value).splitlines()
    assert any(text.startswith(f"x.toml:{line}: ") and said in text for text in lines), lines


def test_every_problem_is_said_in_the_order_of_the_file(write):
    name = write(VALID.replace("f_m = 1.0", "f_m = -1").replace("20.0", "-1"))
    with pytest.raises(MissionError) as refused:
        load(name)
    assert [line.split(":")[1] for line in str(refused.value).splitlines()] == ["3", "9"]


def test_a_file_without_its_flight_is_refused(write):
    with pytest.raises(MissionError, match=r"^x\.toml: \[flight\]: is missing$"):
        load(write('title = "A hover."\n'))


def test_what_cannot_be_read_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissionError, match=r"nowhere\.toml: No such file"):
        load("nowhere.toml")
    (tmp_path / "latin.toml").write_bytes(b'title = "\xe9"\n')
    with pytest.raises(MissionError, match=r"latin\.toml: expected UTF-8 text"):
        load("latin.toml")
    with pytest.raises(MissionError, match=r"paper_nomnal: .*did you mean paper_nominal\?"):
        load("paper_nomnal")


def test_a_file_is_found_from_where_one_stands(write):
    assert load(write(VALID)).source == "x.toml"
    assert load("./x.toml").name == "x"


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("law.f_m=1.4", lambda m: m.law.f_m == 1.4),
        ("law.prediction=demanded", lambda m: m.law.prediction == "demanded"),
        ('law.prediction="demanded"', lambda m: m.law.prediction == "demanded"),
        ("law.bounds.m_max=12", lambda m: m.law.bounds.m_max == 12.0),
        ("wind.steady_m_s=[1,0,0]", lambda m: m.wind.steady_m_s == (1.0, 0.0, 0.0)),
        ("flight.rate_hz=250.0", lambda m: m.flight.rate_hz == 250),
        (" plant.mass_kg = 6 ", lambda m: m.plant.mass_kg == 6.0),
        (
            "expect.reference_error_max_m=0.1",
            lambda m: m.expectations()["reference_error_max_m"]["limit"] == 0.1,
        ),
    ],
)
def test_a_setting_changes_the_mission_and_not_the_original(setting, value):
    mission = load("paper_nominal")
    before = mission.law, mission.wind, mission.flight, mission.plant, mission.expectations()
    assert value(override(mission, setting))
    assert (
        mission.law, mission.wind, mission.flight, mission.plant, mission.expectations()
    ) == before  # fmt: skip


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("law.f_m", "--set law.f_m: expected TABLE.KEY=VALUE"),
        ("law.f_m=", "--set law.f_m=: expected TABLE.KEY=VALUE"),
        ("law.f_m=-1", "--set law.f_m=-1: [law] f_m: expected a number >= 0.1, got -1"),
        ("law.fm=1", "--set law.fm=1: [law] fm: no such key (did you mean f_m?)"),
        (
            "law.f_m=[1",
            "--set law.f_m=[1: expected a TOML value, got [1 (a text stands in quotes: "
            """'law.f_m="[1"')""",
        ),
        (
            "law.module=pd.py",
            "--set law.module=pd.py: expected a TOML value, got pd.py (a text stands in quotes: "
            """'law.module="pd.py"')""",
        ),
        ("law.f_m.x=1", "--set law.f_m.x=1: f_m is not a table"),
        (
            "plant.mass_change={at_s=1.0, mass_kg=6.0, mass_ratio=0.5}",
            "--set plant.mass_change={at_s=1.0, mass_kg=6.0, mass_ratio=0.5}: [plant] mass_change: expected either mass_kg or mass_ratio",
        ),
        ("low.f_m=1", "--set low.f_m=1: [low]: no such key (did you mean law?)"),
    ],
)
def test_a_setting_that_cannot_be_made_is_refused(setting, said):
    with pytest.raises(MissionError, match="^" + re.escape(said)):
        override(load("paper_nominal"), setting)


def test_missions_in_a_folder_of_the_shipped_ones_are_found_by_name():
    assert load("benchmark/steps").name == "steps"
    assert "benchmark/steps" in shipped("benchmark")
    with pytest.raises(MissionError, match=r"did you mean benchmark/steps\?"):
        load("benchmark/step")


def test_the_values_in_force_say_where_they_came_from():
    mission = override(load("paper_nominal"), "law.bounds.m_max=12")
    mission = override(mission, "flight.rate_hz=250", "--rate")
    values = mission.values_in_force()
    assert values["law.f_m"] == Value(1.0, "mission")
    assert values["law.bounds.m_max"] == Value(12.0, "--set")
    assert values["flight.rate_hz"] == Value(250, "--rate")
    assert values["law.gamma"] == Value(1000.0, "mission")
    assert values["law.zeta_m"] == Value(0.8, "default")
    assert values["law.guard_drag"] == Value(0.15, "s1000.toml")
    assert values["law.rotor_lag_s"] == Value(0.05, "s1000.toml")
    assert values["law.tilt_max_deg"] == Value(45.0, "s1000.toml")
    assert values["plant.mass_kg"] == Value(8.0, "sitl_plant/airframes/s1000.toml")
    assert values["flight.setpoints"].origin == "mission"
    json.dumps({key: value.value for key, value in values.items()}, allow_nan=False)


def test_the_printed_law_has_its_own_bounds_in_force():
    values = load("paper_printed").values_in_force()
    assert values["law.bounds.m_min"] == Value(0.5, "mission")
    assert values["law.bounds.J_min"] == Value(0.0, "default")
    assert values["law.J_hat_0"].value == 0.0
    assert values["law.guard"] == Value("warn", "default")


@pytest.mark.parametrize(
    "given",
    [
        {"settings": ["law.f_m=1.4", "law.gamma=1", " law.f_m = 1.5"]},
        {"params": ["NAV_DLL_ACT=1", "NAV_DLL_ACT=2"]},
    ],
)
def test_a_key_that_is_set_twice_is_refused(given):
    ((kind, settings),) = given.items()
    key, option = settings[0].partition("=")[0], {"settings": "--set", "params": "--param"}[kind]
    with pytest.raises(UsageError, match=rf"^{option} {key}: given twice.*expected it once$"):
        prepared("gust_step", **given)
    if kind == "settings":
        with pytest.raises(MissionError, match=rf"^{option} {key}: given twice"):
            load("gust_step", settings)


STEADY, WIND = "wind.steady_m_s=[1.0,0.0,0.0]", "wind={steady_m_s=[2.0,0.0,0.0]}"


@pytest.mark.parametrize(
    ("settings", "params", "why"),
    [
        ([STEADY, WIND], [], "--set wind: given twice"),
        (["vehicle.params.CA_FAILURE_MODE=0"], ["CA_FAILURE_MODE=1"], "CA_FAILURE_MODE: given twice"),
        (["vehicle.params={GF_ACTION=5}"], ["CA_FAILURE_MODE=1"], "--set vehicle.params: given twice"),
        (["vehicle={params={GF_ACTION=5}}"], ["CA_FAILURE_MODE=1"], "--set vehicle: given twice"),
    ],
)  # fmt: skip
def test_a_key_that_is_set_twice_by_other_words_is_refused(settings, params, why):
    with pytest.raises(UsageError) as error:
        prepared("gust_step", settings, params=params)
    assert why in str(error.value)


def test_a_table_may_be_set_before_keys_of_it():
    chosen, _ = prepared("gust_step", [WIND, STEADY])
    assert chosen.values_in_force()["wind.steady_m_s"].value == [1.0, 0.0, 0.0]


def test_keys_whose_names_begin_alike_are_two():
    chosen, _ = prepared("gust_step", ["law.guard=warn", "law.guard_wind_m_s=11.0"])
    assert chosen.values_in_force()["law.guard_wind_m_s"].value == 11.0


def test_a_key_with_a_line_feed_is_told_on_one_line():
    with pytest.raises(UsageError) as error:
        prepared("gust_step", ["law.gu\nard=1"])
    assert str(error.value).startswith("--set law.gu\\nard=1: expected TABLE.KEY=VALUE, a key of")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "given",
    [
        {"settings": [r'law.module="a\nb"']}, {"settings": [r'law.module="a\nb.py"']},
        {"settings": [r'airframe="a\nb.toml"']}, {"settings": [r'flight.plan="a\nb.plan"']},
        {"settings": [r'wind.field={file="a\nb.field"}']}, {"law": "a\nb"}, {"law": "a\nb.py"},
        {"airframe": "a\nb.toml"}, {"airframe": "a\nb"}, {"asked": "a\nb"}, {"asked": "a\nb.toml"},
    ],
)  # fmt: skip
def test_a_name_of_two_lines_is_told_on_one(given):
    with pytest.raises(UsageError) as error:
        prepared(**{"asked": "gust_step", **given})
    (line,) = str(error.value).splitlines()
    assert r"a\nb" in line


def test_every_parameter_of_the_law_can_be_set_and_every_metric_expected():
    keys = {row.key for row in PARAMETERS if row.key}
    of_bounds = LawTable.model_fields["bounds"].annotation.model_fields
    assert {*LawTable.model_fields, *(f"bounds.{k}" for k in of_bounds)} == {
        *keys,
        "bounds",
        "module",
        "unstable_gains",
    }
    assert set(Expect.model_fields) == {*METRICS, *OTHERS}


def test_the_json_schema_is_current():
    on_file = (folder() / mission_schema.NAME).read_text(encoding="utf-8")
    assert on_file == mission_schema.text(), "run: make schemas"
    assert "null" not in on_file
