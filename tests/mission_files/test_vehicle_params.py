"""[vehicle.params]: the vehicle's own parameters by name, checked with line, range and nearest name."""

from __future__ import annotations

import pytest

from fcu.kernel.lanes import WIDTH
from fcu.laws import loader
from fcu.parameters import GivenError, Parameters, chosen, parsed
from fcu.process.configuration import read_airframe, read_settings
from gcs_tools.campaigns import campaign_file
from gcs_tools.campaigns.campaign_file import CampaignError
from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.scenario import refuse_link_faults, scenario
from gcs_tools.missions.mission import (
    MissionError,
    load,
    override,
    with_controller,
    with_parameter,
)

TEXT = """title = "The vehicle hovers."
[flight]
duration_s = 8.0
setpoints = [[0.0, 0.0, 0.0, 5.0]]
[vehicle.params]
NAV_DLL_ACT = 3
COM_OF_LOSS_T = 0.3
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(text):
        (tmp_path / "x.toml").write_text(text)
        return "x.toml"

    return write


def test_values_are_in_force_with_the_origin_of_each(write):
    mission = override(load(write(TEXT)), "vehicle.params.GF_ACTION=5", "--param")
    found = {
        name: (each.value, each.origin)
        for name, each in mission.values_in_force().items()
        if name.startswith("vehicle.")
    }
    assert found == {
        "vehicle.params.NAV_DLL_ACT": (3.0, "mission"),
        "vehicle.params.COM_OF_LOSS_T": (0.3, "mission"),
        "vehicle.params.GF_ACTION": (5.0, "--param"),
    }
    assert mission.placed("vehicle.params.COM_OF_LOSS_T", "mission") == "mission:7"
    assert scenario(mission).parameters == {
        "NAV_DLL_ACT": 3.0, "COM_OF_LOSS_T": 0.3, "GF_ACTION": 5.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("NAV_DLL_ACTT = 3", ("x.toml:6:", "NAV_DLL_ACTT: no such parameter", "did you mean NAV_DLL_ACT?")),
        ("NAV_DLL_ACT = 4", ("x.toml:6:", "expected one of 0, 1, 2, 3, 5, 6, got 4")),
        ("COM_OF_LOSS_T = 99", ("x.toml:6:", "expected 0.1 to 60 s, got 99")),
        ("MAV_SYS_ID = 2", ("x.toml:6:", "read only")),
        ("MR_GURAD = 0", ("x.toml:6:", "did you mean MR_GUARD? It is of the law: set [law] guard (--set law.guard=)")),
        ("MR_F_M = 2", ("x.toml:6:", "a parameter of the law: set [law] f_m (--set law.f_m=)")),
        ("COM_DL_LOSS_T = 5.7", ("x.toml:6:", "COM_DL_LOSS_T: expected a whole number, got 5.7")),
        ("BAT_CRIT_THR = 0.2", ("x.toml:6:", "BAT_CRIT_THR", "below BAT_LOW_THR, 0.15")),
        ("BAT_LOW_THR = 0.01", ("x.toml:6:", "BAT_LOW_THR", "no less than BAT_CRIT_THR, 0.07")),
        ('NAV_DLL_ACT = "land"', ("x.toml:6:", "[vehicle] params.NAV_DLL_ACT: expected a number")),
    ],
)  # fmt: skip
def test_what_no_vehicle_takes_is_refused_with_its_line(write, line, words):
    text = TEXT.replace("NAV_DLL_ACT = 3\nCOM_OF_LOSS_T = 0.3", line)
    with pytest.raises(MissionError) as error:
        load(write(text))
    assert not [word for word in words if word not in str(error.value)], str(error.value)


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ("GF_ACTION = 0\nGF_MAX_HOR_DIST = 2", "with GF_ACTION 0 a vehicle watches no fence"),
        ("GF_ACTION = 1", "the flight has no fence"),
        ("GF_ACTION = 1\nGF_MAX_HOR_DIST = 2", None),
    ],
)
def test_a_fence_that_nobody_watches_is_not_expected(write, params, why):
    text = TEXT.replace("NAV_DLL_ACT = 3\nCOM_OF_LOSS_T = 0.3", params)
    text += "\n[expect]\nfence_breached = false\n"
    if why is None:
        load(write(text))
        return
    with pytest.raises(MissionError, match=rf"x.toml:\d+: \[expect\] fence_breached: {why}"):
        load(write(text))


@pytest.mark.parametrize(
    ("written", "why"),
    [
        ("COM_LOW_BAT_ACT", "--param COM_LOW_BAT_ACT: expected NAME=VALUE with a number"),
        ("=3", "--param =3: expected NAME=VALUE with a number"),
        ("COM_LOW_BAT_ACT=", "--param COM_LOW_BAT_ACT=: expected NAME=VALUE with a number"),
        ("COM_LOW_BAT_ACT=9", "--param COM_LOW_BAT_ACT=9: [vehicle.params] COM_LOW_BAT_ACT: expected one of"),
        ("COM_LOW_BAT_ACT=nan", "--param COM_LOW_BAT_ACT=nan: [vehicle] params.COM_LOW_BAT_ACT"),
    ],
)  # fmt: skip
def test_a_parameter_of_the_command_line_is_refused_by_its_option(write, written, why):
    with pytest.raises(MissionError) as error:
        with_parameter(load(write(TEXT)), written)
    assert str(error.value).startswith(why)


def test_a_vehicle_starts_with_them_and_keeps_them_through_a_reset(tmp_path):
    law = loader.load()
    airframe = read_airframe(law)
    given = chosen({"COM_OF_LOSS_T": 0.3, "NAV_DLL_ACT": 3.0}, law, airframe.tables)
    settings = read_settings(law, None, 500.0, airframe)
    file = tmp_path / "parameters.toml"
    file.write_text("COM_OF_LOSS_T = 5.0\n")
    for params in (
        Parameters(settings, 1, None, law, airframe, given),
        Parameters(
            settings, 1, file, law, airframe, parsed(f"{n}={v!r}" for n, v in given.items())
        ),
    ):
        params.set("NAV_DLL_ACT", 0.0, False)
        params.reset()
        assert (params["COM_OF_LOSS_T"], params["NAV_DLL_ACT"]) == (0.3, 3.0)
        assert params.settings is settings


def test_flights_without_an_autopilot_refuse_vehicle_parameters(write):
    mission = load(write(TEXT))
    with pytest.raises(
        MissionError, match=r"\[vehicle.params\] NAV_DLL_ACT: a controller of your own"
    ):
        with_controller(mission, ("true",))
    with pytest.raises(loader.LawError, match=r"\[vehicle.params\] COM_OF_LOSS_T is of"):
        law_alone.fly(scenario(mission))
    with pytest.raises(GivenError) as error:
        chosen({"X": 1.0}, mission.flown, mission.airframe.tables)
    assert error.value.name == "X"
    with pytest.raises(GivenError, match="expected NAME=VALUE"):
        parsed(["X=y"])


CAMPAIGN = """title = "Lost scripts."
mission = "x.toml"
flights = 2
fly = "{fly}"
set = {{ {set} }}
[draw]
"vehicle.params.COM_OF_LOSS_T" = {{ uniform = [{low}, 2.0] }}
"""


@pytest.mark.parametrize(
    ("fly", "low", "more", "why"),
    [
        ("vehicle", 0.5, "", ""),
        ("vehicle", 0.01, "", "COM_OF_LOSS_T: expected 0.1 to 60 s, got 0.01"),
        ("law", 0.5, "", 'fly = "law": [vehicle.params] need a vehicle'),
        (
            "vehicle", 0.5, '"plant.faults" = [{ kind = "link_lost", at_s = 1.0, share = 0.5 }]',
            "link_lost is a fault of the plant link",
        ),
    ],
)  # fmt: skip
def test_a_campaign_draws_them_as_any_other_value(write, tmp_path, fly, low, more, why):
    write(TEXT)
    text = CAMPAIGN.format(fly=fly, low=low, set=more)
    if why:
        with pytest.raises(CampaignError) as error:
            campaign_file.parsed(text, "c.toml", tmp_path, "c")
        assert why in str(error.value)
        return
    campaign = campaign_file.parsed(text, "c.toml", tmp_path, "c")
    values = campaign.draws.values(0, campaign.draws.quantities(0), campaign.variants[0].base)
    assert 0.5 <= values["vehicle.params.COM_OF_LOSS_T"] <= 2.0


@pytest.mark.parametrize("kind", ["state_off", "battery_drain", "battery_level", "ground_lost"])
def test_a_campaign_of_a_law_alone_refuses_faults_of_an_autopilot(write, tmp_path, kind):
    write(TEXT.partition("[vehicle.params]")[0])
    more = {"battery_drain": "drain_a = 2.0", "battery_level": "remaining = 0.1"}.get(
        kind, "for_s = 0.1"
    )
    fault = f'"plant.faults" = [{{ kind = "{kind}", at_s = 1.0, {more} }}]'
    head = CAMPAIGN.partition("[draw]")[0]
    draw = '[draw]\n"plant.mass_kg" = { uniform = [0.9, 1.1], relative = true }\n'
    texts = {fly: head.format(fly=fly, set=fault) + draw for fly in ("law", "vehicle")}
    with pytest.raises(CampaignError, match=rf"faults\[0\]: {kind} is answered by an autopilot"):
        campaign_file.parsed(texts["law"], "c.toml", tmp_path, "c")
    campaign_file.parsed(texts["vehicle"], "c.toml", tmp_path, "c")


@pytest.mark.parametrize("more", ["NAV_DLL_ACT = 3", ""])
def test_flights_in_lanes_refuse_what_is_of_an_autopilot(write, more):
    fault = '[[plant.faults]]\nkind = "state_off"\nat_s = 1.0\nfor_s = 0.1\n'
    text = TEXT.partition("[vehicle.params]")[0]
    mission = load(write(f"{text}[vehicle.params]\n{more}\n" if more else text + fault))
    scenes = [scenario(mission)] * WIDTH
    results = [found for _, found in law_flights.each(scenes, in_all=law_flights.ALWAYS)]
    assert len(results) == WIDTH
    assert all(isinstance(found, loader.LawError) for found in results)


def test_a_fault_of_the_link_is_refused_by_name_in_process(write):
    fault = '[[plant.faults]]\nkind = "link_late"\nat_s = 1.0\nshare = 0.5\nlate_s = 0.1\n'
    with pytest.raises(MissionError, match=r"faults\[0\]: link_late"):
        refuse_link_faults(load(write(TEXT + fault)))
    refuse_link_faults(load(write(TEXT)))


@pytest.mark.parametrize(
    ("expect", "why"),
    [
        ('failsafe = "batery_low"', "failsafe.name: expected none, battery_critical"),
        ('failsafe = { name = "none", from = 1.0 }', "a failsafe, which alone has a time"),
        ('failsafe = { name = "station_lost", from = 2.0, to = 1.0 }', "a time from 2 s on"),
        ('mode = "Landing"', "[expect] mode: expected Hold, Takeoff"),
        ("fence_breached = 1", "[expect] fence_breached: expected true or false"),
    ],
)
def test_an_expectation_of_the_vehicle_that_can_never_be_met_is_refused(write, expect, why):
    with pytest.raises(MissionError) as error:
        load(write(f"{TEXT}[expect]\n{expect}\n"))
    assert why in str(error.value)


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ('kind = "motor_weak"\neffectiveness = 1.0', "effectiveness: motor_weak of 1.0 changes nothing"),
        ('kind = "state_jumps"\njump_m = [0.0, 0.0, 0.0]', "jump_m: a jump of 0 m changes nothing"),
        ('kind = "battery_drain"\ndrain_a = 0.0', "drain_a: battery_drain of 0.0 changes nothing"),
        ('kind = "battery_level"\nremaining = 1.0', "remaining: battery_level of 1.0 changes nothing"),
        ('kind = "link_lost"\nshare = 0.0', "share: link_lost of 0.0 changes nothing"),
        ('kind = "link_late"\nshare = 0.5\nlate_s = 0.0', "late_s: link_late of 0.0 changes nothing"),
        ('kind = "state_delayed"\ndelay_s = 0.0', "delay_s: state_delayed of 0.0 changes nothing"),
        (
            'kind = "state_delayed"\ndelay_s = 0.0009',
            r"x.toml:11: [plant] faults[0].delay_s: a delay of 0.0009 s changes nothing: expected a tick or"
            " more (0.002 s)",
        ),
    ],
)  # fmt: skip
def test_a_fault_that_changes_nothing_is_refused(write, fault, why):
    with pytest.raises(MissionError) as error:
        load(write(f"{TEXT}[[plant.faults]]\nat_s = 1.0\n{fault}\n"))
    assert why in str(error.value)


def test_a_delay_of_a_tick_is_none_of_them(write):
    fault = 'kind = "state_delayed"\ndelay_s = 0.002'
    load(write(f"{TEXT}[[plant.faults]]\nat_s = 1.0\n{fault}\n"))


def test_a_ground_link_is_lost_by_a_mission_of_setpoints_alone(write):
    lost = '[[plant.faults]]\nkind = "ground_lost"\nat_s = 1.0\nfor_s = 2.0\n'
    scene = scenario(load(write(TEXT + lost)))
    assert [scene.hears(tick) for tick in (499, 500, 1499, 1500)] == [True, False, False, True]
    items = '[[flight.items]]\nkind = "hold"\nfor_s = 1.0\n'
    text = TEXT.replace("setpoints = [[0.0, 0.0, 0.0, 5.0]]", "").replace("[vehicle.params]", f"{items}[vehicle.params]")  # fmt: skip
    with pytest.raises(
        MissionError, match=r"faults\[0\]: ground_lost needs a mission of setpoints"
    ):
        scenario(load(write(text + lost)))


def test_the_flight_controller_takes_a_parameter_once():
    assert parsed(["NAV_DLL_ACT=1", "COM_OF_LOSS_T=2"]) == {
        "NAV_DLL_ACT": 1.0,
        "COM_OF_LOSS_T": 2.0,
    }
    with pytest.raises(GivenError, match="given twice"):
        parsed(["NAV_DLL_ACT=1", "NAV_DLL_ACT = 2"])
