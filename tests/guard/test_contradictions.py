"""What contradicts the beliefs: told when it is there, and not in flights inside them."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.guard import contradictions
from fcu.guard.types import Contradicted, Signs
from fcu.interface.status_texts import Code
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import fly, prepared
from gcs_tools.pictures.quantities import CONTRADICTED
from gcs_tools.recording.reader import read

STILL = "wind.amplitude_m_s=[0,0,0]"
LASTED_S = 2.0 * contradictions.LASTS_S


def since(mission, *settings):
    """When (s) each sign was told first."""
    _, rows = law_alone.fly(prepared(mission, settings)[1])
    up = column(Tick, rows, "guard.contradicted") > 0.5
    return {
        sign: float(rows[np.argmax(up[:, i]), 0])
        for i, sign in enumerate(Contradicted._fields)
        if up[:, i].any()
    }


@pytest.mark.parametrize("mass", [7.0, 8.0, 9.0])
@pytest.mark.parametrize(
    "wind",
    [
        ["wind.amplitude_m_s=[7.2,7.2,5.7]"],
        ["wind.amplitude_m_s=[11,11,5]"],
        ["wind.steady_m_s=[8,8,0]", STILL],
    ],
)
@pytest.mark.computes
def test_inside_the_beliefs_nothing_is_told(mass, wind):
    assert since("urban_step", *wind, f"plant.mass_kg={mass}") == {}


@pytest.mark.parametrize("mass", [7.0, 9.0])
def test_the_drag_of_its_own_climb_is_no_mass(mass):
    """Over 100 m, where next to no wind is believed: 16 N of drag for a second or more."""
    way = "flight.setpoints=[{at_s=0.0,position_m=[0,0,100]},{at_s=25.0,position_m=[0,0,0]}]"
    calm = "flight.duration_s=50", "law.guard_wind_m_s=2", "law.guard_wind_rate_m_s2=2"
    assert since("urban_step", STILL, *calm, way, f"plant.mass_kg={mass}") == {}


@pytest.mark.parametrize("mass", [6.0, 10.0])
@pytest.mark.parametrize("sets", [(), ("law.bounds.m_min=1", "law.bounds.m_max=20")])
def test_noise_and_the_set_of_the_estimate_hide_no_mass(mass, sets):
    found = since("noisy_state", STILL, f"plant.mass_kg={mass}", *sets)
    assert found.keys() == {"lighter" if mass < 7.0 else "heavier"}


@pytest.mark.parametrize("mission", ["paper_printed", "urban_step"])
def test_the_printed_law_and_no_trim_tell_nothing(mission):
    assert since(mission, *(["law.trim_max=0"] if mission == "urban_step" else [])) == {}


@pytest.mark.parametrize("mission", ["paper_nominal", "figure_eight", "noisy_state", "take_off"])
def test_nor_in_missions_that_keep_to_them(mission):
    assert since(mission) == {}


@pytest.mark.parametrize(
    ("settings", "sign"),
    [
        (["plant.mass_kg=6.0"], "lighter"),
        (["plant.mass_kg=10.0"], "heavier"),
        (["wind.steady_m_s=[0,0,12]", STILL], "lighter"),
        (["wind.steady_m_s=[0,0,-12]", STILL], "heavier"),
        (["wind.steady_m_s=[11,11,0]", STILL], "drag"),
    ],
)
def test_what_is_beyond_them_is_told(settings, sign):
    found = since("urban_step", *settings)
    assert found.keys() == {sign}
    assert found[sign] < LASTED_S + 2.0  # the estimates come first


@pytest.mark.slow
def test_a_mass_dropped_out_of_the_belief_is_told_to_stations_and_recorded(tmp_path):
    told = {}
    for way, in_process in (("wire", False), ("process", True)):
        run = tmp_path / way
        result = fly("package_drop", in_process=in_process, out=run, figure="never")
        recording = read(run / "flight.mcap")
        (event,) = (e for e in recording.events if e.code == Code.NOT_AS_BELIEVED.name)
        first = recording.fcu["t"][np.argmax(recording.fcu["guard.contradicted.lighter"] > 0.5)]
        assert event.level == "warning"
        assert event.values == ({"code": Code.LIGHTER.name, "values": [7.0]},)
        assert event.t == pytest.approx(first)
        assert 12.0 < first < 12.0 + LASTED_S
        assert result.metrics["contradicted_fraction"] > 0.1
        told[way] = event
    assert told["wire"] == told["process"]


def test_inside_a_belief_that_holds_both_masses_it_is_not():
    assert since("package_drop", "law.guard_mass_kg=[5.5,9]", "law.bounds.m_min=5.5") == {}


def test_each_sign_has_its_bound(settings_of):
    law, params = settings_of()
    enough = contradictions.enough(params, law)
    none = contradictions.none(params, law)
    assert sum(contradictions.told(params, law, none)) == 0.0
    for at, beyond in (
        (Signs(enough, 0.0, enough, contradictions.PINNED), 1.01),
        (Signs(-enough, 0.0, -enough, contradictions.PINNED), 1.01),
    ):
        assert sum(contradictions.told(params, law, at)) == 0.0
        more = Signs(*(beyond * each for each in at))._replace(drag=1e-3)
        assert sum(contradictions.told(params, law, more)) == 4.0


def test_tools_know_the_signs_by_the_same_names():
    assert Contradicted._fields == CONTRADICTED
