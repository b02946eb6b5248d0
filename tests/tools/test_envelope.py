"""`gcs envelope`: what it prints, its codes, its figure; and that its numbers are those of flights."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

import gcs_tools
from fcu.guard import margin
from fcu.kernel.algebra import Vec3
from fcu.process.settings import Settings
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import Terms, envelope, largest, terms, tightest, with_guard
from gcs_tools.judging.preflight_check import refusal
from gcs_tools.missions.mission import load, override
from gcs_tools.pictures.plot.envelope import save
from gcs_tools.studies.envelope_map import PAPER, WAYS, saturates
from gcs_tools.studies.guard_check import check, holds
from tests import command_line
from tests.patience import PATIENCE_S


def gcs(*arguments):
    return command_line.gcs("envelope", *arguments)


def test_a_mission_that_is_certain_says_so(tmp_path):
    """As a program, with its figure."""
    picture = tmp_path / "room.png"
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "envelope", "gust_step", "--figure", picture],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "The condition holds" in done.stdout
    assert "step to the side" in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert str(picture) in done.stdout


def test_a_setpoint_that_the_guard_governs_is_no_failure():
    done = gcs("paper_fast_governed")
    assert done.exit_code == 0
    headline, given = " ".join(done.stdout.split()).split("For the setpoints as given it fails")
    assert "With the guard the condition holds" in headline
    assert "fail" not in headline
    assert re.match(r": 37\d\.\d N short", given)
    beyond = gcs("gust_step", "--set", "wind.steady_m_s=[30, 0, 0]", "--set", "plant.mass_kg=12")
    assert "is beyond guard_wind_m_s 12" in beyond.stdout
    assert "12 kg, is not in guard_mass_kg" in beyond.stdout


def test_of_a_plan_the_margin_on_the_way_to_each_item_is_told():
    done = gcs("plan_square", "--json")
    assert done.exit_code == 0
    found = json.loads(done.stdout)
    assert found["governed"]
    assert found["unflyable"] == []
    assert [each["item"] for each in found["plan"]] == [2, 3, 4, 5, 6]
    assert found["margin_n"] == min(each["margin_n"] for each in found["plan"])
    text = " ".join(gcs("plan_square").stdout.split())
    least = min(found["plan"], key=lambda each: each["margin_n"])["item"]
    assert f"{least} NAV_WAYPOINT <- least" in text
    refused = gcs("plan_square", "--set", "law.guard=refuse")
    assert refused.exit_code == 1
    assert "MPC_XY_CRUISE" in refused.stdout


def test_a_plan_that_the_vehicle_does_not_take_has_no_margins(tmp_path):
    tables = json.loads((Path(gcs_tools.__file__).parents[1] / "missions/square.plan").read_text())
    tables["mission"]["items"][3]["command"] = 84
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    done = gcs(path)
    assert done.exit_code == 2
    assert "item 3" in done.stderr


@pytest.mark.parametrize("mission", ["paper_fast_governed", "paper_fast"])
def test_a_condition_that_fails_is_told_to_be_no_prediction(mission):
    assert "sufficient, not necessary" in gcs(mission).stdout
    assert "sufficient, not necessary" not in gcs("gust_step").stdout


def test_a_guard_that_has_no_room_is_not_said_to_help():
    done = gcs("urban_step", "--set", "law.guard_noise_velocity_m_s=0.12")
    assert done.exit_code == 1
    assert "With the guard" not in done.stdout
    assert "The guard cannot help" in done.stdout
    assert "Noise may saturate something: guard_noise_velocity_m_s takes most" in done.stdout


def test_noise_that_hover_has_no_room_for_fails_a_mission_that_is_governed():
    done = gcs("urban_step", "--set", "law.guard_noise_velocity_m_s=0.005")
    assert "With the guard the condition holds" in done.stdout
    assert "But noise may saturate the torque" in done.stdout
    assert done.exit_code == 1
    assert gcs("urban_step", "--set", "law.guard_noise_velocity_m_s=0.0002").exit_code == 0


HEAVY = Path(__file__).parents[1] / "own_airframe" / "heavy.toml"
FAR = "flight.setpoints=[[0.0, 0.0, 0.0, 3.0], [9.0, 0.0, 120.0, 3.0]]"


def test_a_setpoint_that_cannot_be_flown_as_written_fails_a_mission_that_does_not_expect_it():
    chosen = "gust_step", "--set", FAR, "--set", "flight.arena_m=500", "--set", "law.f_m=0.3"
    governed = *chosen, "--set", "law.guard=govern"
    done = gcs(*governed)
    assert done.exit_code == 1
    said = " ".join(done.stdout.split())
    assert "With the guard the condition holds" in said
    assert 'setpoint at 9 s, (0, 120, 3) m, limited: "Setpoint 120 m away limited to 100 m"' in said
    expected = gcs(*governed, "--set", "expect.limited=true")
    assert expected.exit_code == 0
    assert "Not flown as written (expected)" in expected.stdout
    outside = gcs("gust_step", "--set", "flight.arena_m=0.5", "--set", "law.guard=govern",
                  "--set", "flight.setpoints=[[0.0, 0.0, 0.0, 0.6]]", "--json")  # fmt: skip
    assert outside.exit_code == 1
    assert [each["why"] for each in json.loads(outside.stdout)["unflyable"]] == ["arena"]


def test_a_setpoint_that_stands_too_short_for_the_stated_time_is_told():
    chosen = "--set", FAR, "--set", "law.guard=govern", "--set", "flight.arena_m=500"
    said = json.loads(gcs("gust_step", *chosen, "--json").stdout)
    first, second = said["arrivals"]
    assert first["within_s"] == pytest.approx(said["arrives_s"])
    assert (second["at_s"], second["stands_s"]) == (9.0, 6.0)
    assert second["within_s"] > first["within_s"]
    told = " ".join(gcs("gust_step", *chosen).stdout.split())
    within = math.ceil(second["within_s"])
    assert f"setpoint of 9 s stands for 6 s; to be within 0.3 m of it, from rest at the one before, may take {within} s" in told  # fmt: skip
    warns = json.loads(gcs("gust_step", "--set", "law.guard=warn", "--json").stdout)
    assert warns["arrivals"] == []


def test_why_no_arrival_is_stated_is_told_with_the_wind_for_which_it_is():
    """A vehicle of 25 kg, whose gains follow from its file, and the numbers of docs/airframes.md."""
    heavy = "urban_step", "--airframe", HEAVY
    said = json.loads(gcs(*heavy, "--json").stdout)
    assert said["arrives_s"] is None
    assert "0.52 m off its reference" in said["unstated"]
    assert said["unstated"] in " ".join(gcs(*heavy).stdout.split())
    (calm,) = re.findall(r"with guard_wind_m_s (\S+) it is stated", said["unstated"])
    assert calm == "5.6"
    for wind, is_stated in ((5.6, True), (5.8, False)):
        found = json.loads(gcs(*heavy, "--set", f"law.guard_wind_m_s={wind}", "--json").stdout)
        assert (found["arrives_s"] is not None, found["unstated"] == "") == (is_stated, is_stated)
    assert json.loads(gcs("urban_step", "--json").stdout)["unstated"] == ""
    warns = json.loads(gcs(*heavy, "--set", "law.guard=warn", "--json").stdout)
    assert (warns["arrives_s"], warns["unstated"]) == (None, "")


@pytest.mark.parametrize("mission", ["paper_nominal", "gust_step"])
def test_gains_that_a_vehicle_refuses_come_first_and_without_margins(mission):
    """Of the guarded mission too: a guard governs no loop that is unstable."""
    done = gcs(mission, "--set", "law.f_m=5")
    assert done.exit_code == 1 and " N" not in done.stdout
    found = json.loads(gcs(mission, "--set", "law.f_m=5", "--json").stdout)
    assert found["unstable"].startswith("pitch")
    assert not found["holds"] and not found["governed"]
    assert json.loads(gcs(mission, "--json").stdout)["unstable"] == ""


def test_every_key_of_its_json_is_explained():
    said = json.loads(
        gcs("urban_step", "--set", "law.guard_noise_velocity_m_s=0.002", "--set",
            "flight.arena_m=1", "--json").stdout
    )  # fmt: skip
    readme = (Path(__file__).parents[2] / "gcs_tools/judging/README.md").read_text()
    rows = readme.partition("`gcs envelope --json`")[2]
    inner = [said["terms"], said["noise"], *(said[k][0] for k in ("reach", "changes", "beliefs"))]
    for key in {key for table in (said, *inner) for key in table}:
        assert f"`{key}`" in rows, key


def test_a_setpoint_outside_says_what_uses_the_margin_up_and_what_would_do():
    done = gcs("paper_fast", "--json")
    assert done.exit_code == 1, done.stderr
    said = json.loads(done.stdout)
    assert not said["holds"]
    assert said["margin_n"] < -100.0
    assert said["terms"]["left"] == pytest.approx(said["margin_n"])
    f_m = next(c for c in said["changes"] if c["what"] == "f_m")
    assert 0.3 < f_m["would_do"] < 1.0
    plain = gcs("paper_fast").stdout
    assert plain.count("uses up most") == 1
    assert re.search(r"\bf_m 1\.4 -> 0\.\d+ rad/s", plain)


def test_what_is_not_enough_alone_is_not_listed_with_what_is():
    done = gcs("paper_nominal")
    assert done.exit_code == 1
    enough, alone = done.stdout.split("Any one of these changes would make it fit:")[1].split(
        "None of these"
    )
    assert "f_m 1 -> 0." in enough and 'law.guard="govern"' in enough
    assert "guard_wind_m_s" in alone and "->" not in alone
    assert "-0.0" not in done.stdout
    again = gcs("paper_nominal")
    assert again.stderr == ""  # nothing is compiled any more, and nothing is said of it


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("paper_nominall",), "did you mean paper_nominal"),
        (("gust_step", "--figure", "room.txt"), "ends in none of .png"),
        (("gust_step", "--figure", "nowhere/room.png"), "there is no folder nowhere"),
        (("gust_step", "--set", "law.guard_mass_kg=[9, 7]"), "guard_mass_kg"),
        (("gust_step", "--set", "law.guard=never"), "guard"),
    ],
)
def test_what_cannot_be_looked_at_is_said(arguments, said):
    done = gcs(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


KNOWN = ("guard_noise_position_m", "guard_noise_attitude_rad", "guard_noise_rate_rad_s")


def noisy(velocity, kind="bounded", mission="urban_step"):
    chosen = (f"law.guard_noise_velocity_m_s={velocity}", f'law.guard_noise="{kind}"')
    found = load(mission)
    for setting in chosen:
        found = override(found, setting)
    return found


def test_beliefs_are_printed_each_with_its_key():
    done = gcs("gust_step", "--set", "law.guard_delay_s=0.004")
    for key in (*KNOWN, "guard_noise_velocity_m_s", "guard_mass_kg", "vehicle.inertia_kg_m2",
                "rotors.thrust_coefficient", "guard_drag", "guard_wind_m_s",
                "guard_wind_rate_m_s2", "rotor_lag_s", "flight.rate_hz"):  # fmt: skip
        assert key in done.stdout, key
    assert re.search(r"delay to the rotor +0\.004 +s +guard_delay_s", done.stdout)
    assert "Torque of roll and pitch" not in done.stdout  # no noise is believed
    said = json.loads(gcs("gust_step", "--json").stdout)
    assert said["noise"] is None
    assert len(said["beliefs"]) == 14


def test_noise_takes_its_part_of_force_and_torque_and_what_there_is_room_for_is_said():
    clean, some = envelope(noisy(0.0)), envelope(noisy(0.002))
    assert clean.noise is None
    assert some.noise.force_n == pytest.approx(some.terms.noise) and some.terms.noise > 1.0
    assert some.terms.left == pytest.approx(some.margin_n)
    of = some.noise
    assert of.left_n_m == pytest.approx(of.there_n_m - of.gust_n_m - of.noise_n_m)
    assert (of.lack, of.per_hour) == ("", None)
    white = envelope(noisy(0.002, "gaussian")).noise
    assert 0.0 < white.per_hour < 0.2
    said = gcs("urban_step", "--set", "law.guard_noise_velocity_m_s=0.002")
    assert "There is room for what such a noise does at most" in said.stdout


@pytest.mark.parametrize("kind", ["bounded", "gaussian"])
def test_noise_that_there_is_no_room_for_is_said_with_what_would_do(kind):
    much = envelope(noisy(0.02, kind)).noise
    assert much.left_n_m < 0.0
    assert much.per_hour is None
    assert much.lack.startswith("guard_noise_velocity_m_s takes most; enough is ")
    amount = float(re.search(r"guard_noise_velocity_m_s 0.02 -> (\S+)", much.lack)[1])
    assert envelope(noisy(0.98 * amount, kind)).noise.lack == ""
    assert envelope(noisy(1.1 * amount, kind)).noise.lack != ""
    little = envelope(noisy(1.1 * amount, kind)).noise.lack
    gamma = float(re.search(r"gamma \S+ -> (\S+)", little)[1])
    assert envelope(override(noisy(1.1 * amount, kind), f"law.gamma={gamma}")).noise.lack == ""


def test_noise_and_delay_that_are_not_believed_are_said():
    plain = gcs("noisy_state", "--set", "plant.delay_s=0.004")
    for key in (*KNOWN, "guard_noise_velocity_m_s", "guard_delay_s"):
        assert f"beyond {key} 0" in " ".join(plain.stdout.split()), key
    assert "six times a spread of 0.02 m/s" in " ".join(plain.stdout.split())


def test_settings_said_to_do_suffice():
    """The largest f_m it names meets the condition, one that is 5 % more does not."""
    found = envelope(load("paper_nominal"))
    f_m = next(c.would_do for c in found.changes if c.what == "f_m")
    assert envelope(override(load("paper_nominal"), f"law.f_m={f_m!r}")).holds
    assert not envelope(override(load("paper_nominal"), f"law.f_m={1.05 * f_m!r}")).holds


SIZE, SPEED, CENTRE, PERIOD = (
    f"flight.curve.{key}" for key in ("size_m", "speed_max_m_s", "centre_m", "period_s")
)


@pytest.mark.parametrize(
    ("mission", "settings", "nearer", "slower"),
    [
        ("paper_nominal", [], ["flight.setpoints"], []),
        ("figure_eight", [], [SIZE, SPEED], [SPEED]),
        ("figure_eight", [f"{SPEED}=4.0", f"{CENTRE}=[2.0, 0.0, 1.0]"], [SIZE, SPEED, CENTRE], []),
        ("figure_eight", ["flight.curve={kind='figure_eight', size_m=[9.0, 3.0], period_s=6.0}"],
         [SIZE], [PERIOD]),
    ],
    ids=["steps", "curve", "elsewhere", "by its period"],
)  # fmt: skip
def test_the_settings_it_names_do(mission, settings, nearer, slower):
    """Of a curve too: its keys are named, and not distances that no file has."""
    given = load(mission, settings)
    found = [each for each in envelope(given).changes if each.would_do is not None]
    for change in found:
        changed = given
        for setting in change.settings:
            changed = override(changed, setting)
        assert envelope(changed).holds, change
    assert [setting.partition("=")[0] for setting in found[0].settings] == nearer
    assert [each.what for each in found if "curve" in each.what] == slower


def test_the_terms_add_up_to_the_condition():
    settings = scenario(load("paper_nominal")).settings
    a, v = Vec3(1.0, -0.5, 0.7), Vec3(2.0, 1.0, -1.0)

    def spent_of(settings: Settings) -> Terms:
        left = margin.condition(margin.known(settings.guard, settings.law), a, v, 0.0)
        spent = terms(settings, a, v, left)
        assert spent.left == pytest.approx(left)
        return spent

    spent = spent_of(with_guard(settings, lift=math.inf, lift_turns=math.inf))
    assert min(spent[:6]) > 0.0
    assert spent.doubt == pytest.approx(-spent.tracking)  # nothing jumps, nothing is closed here
    # and where tilts that steer end first
    assert spent_of(settings).steering > 0.0 == spent_of(settings).doubt


@pytest.mark.parametrize("mission", ["urban_step", "paper_nominal", "figure_eight"])
def test_what_would_be_refused_is_short_of_the_number_that_the_vehicle_says(mission):
    """One quantity, one number: before flight, and in the words that the flight ends with."""
    chosen = override(load(mission), "law.guard='refuse'")
    found, said = envelope(chosen), refusal(scenario(chosen))
    asked = re.search(r"setpoint at (\S+) s refused: .* needs (\d+) N more", said)
    assert asked is not None, said
    assert float(asked[2]) == math.ceil(-found.margin_n)
    assert found.at_s >= float(asked[1])
    assert found.refused == said
    printed = " ".join(gcs(mission, "--set", "law.guard=refuse").stdout.split())
    assert f"The vehicle refuses it: {said}." in printed
    assert "limited:" not in printed  # what comes after a refused setpoint is another flight


def test_the_exact_set_reaches_farther_than_the_ball_and_that_farther_than_31():
    for row in envelope(load("paper_nominal")).reach:
        if row.ball is not None:
            assert row.exact >= 0.99 * row.ball > 0.0
        if row.theorem is not None:
            assert row.ball > row.theorem > 0.0


@pytest.mark.parametrize("way", sorted(WAYS))
def test_the_largest_step_it_names_saturates_nothing_in_the_papers_wind(way):
    step = next(r for r in envelope(load("gust_step")).reach if r.what == f"step {way}").exact
    assert not any(saturates(world, 2.0, WAYS[way], step) for world in PAPER)
    assert saturates(PAPER[0], 2.0, WAYS[way], 6.0 * step)


def test_a_search_finds_the_end_of_what_holds():
    assert largest(lambda x: x <= 3.7) == pytest.approx(3.7, rel=2e-3)
    assert largest(lambda x: False) is None
    assert largest(lambda x: True, 5.0) == 5.0


def test_flights_inside_saturate_nothing_and_governed_flights_nothing_at_all():
    """A few of `python -m gcs_tools.studies.guard_check`, with a seed of their own."""
    found = check(30, seed=7)
    assert holds(found), found
    assert found.ways_inside > 10
    assert found.warned_saturated > 5
    assert found.condition_least_n > -2.0


def test_the_example_of_the_guards_readme(tmp_path):
    """Every line that it shows is printed, and the flight saturates nothing."""
    text = (Path(__file__).parents[2] / "fcu/guard/README.md").read_text()
    (mission,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (shown,) = re.findall(r"```\n(my_load guard.*?)```", text, re.DOTALL)
    file = tmp_path / "my_load.toml"
    file.write_text(mission)
    words = " ".join(gcs(file).stdout.split())
    for line in shown.splitlines():
        assert " ".join(line.split()) in words, line
    flown = command_line.gcs(
        "fly", file, "--in-process", "--figure", "never", "--out", tmp_path / "run"
    )
    assert flown.exit_code == 0, flown.output
    file.write_text(mission.replace("bounds =", "# bounds ="))
    assert "the mass estimate is kept in [7, 9] kg" in " ".join(gcs(file).stdout.split())


def test_items_are_looked_at_where_the_vehicle_does_not_lead_itself():
    """From the take-off on; a path as it is streamed, which is gentler than a step to its end."""
    given = load("square_and_land")
    found = envelope(given)
    assert any("take-off" in remark for remark in found.remarks)
    assert found.governed and found.unflyable == () and found.arrivals == ()
    up, land = '{ kind = "take_off", height_m = 6.0 }', '{ kind = "land" }'
    along = '{ kind = "follow", speed_m_s = 1.0, acceleration_m_s2 = 0.3, points_m = [[0, 0, 6], [9, 0, 6]] }'
    there = '{ kind = "go_to", position_m = [9, 0, 6] }'
    path, step = (
        scenario(load("square_and_land", [f"flight.items=[{up}, {item}, {land}]"]))
        for item in (along, there)
    )
    assert tightest(path).margin > 0.0 > tightest(step).margin
    assert path.begin.r_E == (0.0, 0.0, 6.0)


def test_the_figure_of_a_mission_of_items_is_drawn(tmp_path):
    mission = load("square_and_land")
    save(mission, envelope(mission), tmp_path / "room.png")
    assert (tmp_path / "room.png").stat().st_size > 10_000
