"""Draws: by seed and number alone, distributed as the file says."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gcs_tools.campaigns.campaign_file import CampaignError, read
from gcs_tools.campaigns.distributions import Distribution
from gcs_tools.campaigns.draws import Draws

U = (np.arange(20_000) + 0.5) / 20_000


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"uniform": [2.0, 5.0]}, stats.uniform(2.0, 3.0)),
        ({"log_uniform": [0.01, 10.0]}, stats.loguniform(0.01, 10.0)),
        ({"normal": [3.0, 0.5]}, stats.norm(3.0, 0.5)),
        ({"normal": [0.0, 1.0], "low": -0.5, "high": 2.0}, stats.truncnorm(-0.5, 2.0)),
        ({"log_normal": [2.0, 0.3]}, stats.lognorm(0.3, scale=2.0)),
        ({"triangular": [1.0, 2.0, 5.0]}, stats.triang(0.25, 1.0, 4.0)),
    ],
)
def test_a_distribution_has_the_quantiles_of_scipy_s(given, expected):
    found = np.array(Distribution.model_validate(given).at(U))
    np.testing.assert_allclose(found, expected.ppf(U), rtol=1e-9, atol=1e-9)


def test_choices_and_whole_numbers_have_their_shares():
    choice = Distribution.model_validate({"choice": ["a", "b", 3], "weights": [1.0, 0.0, 3.0]})
    found = choice.at(U)
    assert [found.count(each) for each in ("a", "b", 3)] == [5000, 0, 15000]
    whole = Distribution.model_validate({"integer": [-1, 2]}).at(U)
    assert [whole.count(each) for each in range(-2, 4)] == [0, 5000, 5000, 5000, 5000, 0]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("{ unifrom = [1.0, 2.0] }", "did you mean uniform?"),
        ("{ uniform = [2.0, 1.0] }", "expected [least, most]"),
        ("{ uniform = [1.0, 2.0], normal = [0.0, 1.0] }", "exactly one of"),
        ("{ log_uniform = [0.0, 1.0] }", "a number > 0"),
        ("{ normal = [1.0, -1.0] }", "a standard deviation >= 0"),
        ("{ normal = [1.0, 0.1], low = 50.0 }", "a distribution that reaches"),
        ("{ choice = [] }", "plant.mass_kg"),
        ("{ choice = [7, 8.0, 7.0], weights = [1, 2, 3] }", "values that differ (7.0 is there twice)"),
        ("{ choice = [1.0, 2.0], weights = [1.0] }", "as many weights"),
        ("{ choice = [1.0, 2.0], weights = [1e308, 1e308] }", "a sum that is a number"),
        ("{ uniform = [1.0, inf] }", "finite"),
        ("{ uniform = [0.0, 1e308] }", "uniform"),
        ("{ integer = [0, 9223372036854775807] }", "integer"),
        ("{ log_normal = [1.0, 1e3] }", "low and high bound a normal distribution"),
        ("3.0", "expected a table, got 3.0 (a table of uniform, "),
        ("{ uniform = [-1.0, 2.0] }", "expected a number > 0, got -1"),
        ("{ normal = [1.0, 0.5] }", "low and high bound a normal distribution"),
    ],
)  # fmt: skip
def test_a_distribution_that_cannot_be_drawn_is_said(make, given, said):
    with pytest.raises(CampaignError, match=r"drawn\.toml") as error:
        make(draw=f'"plant.mass_kg" = {given}')
    assert said in str(error.value)


def test_true_and_1_are_two_choices():
    assert Distribution.model_validate({"choice": [True, 1, "1", [1], [2]]}).choice is not None


def test_an_unknown_quantity_is_named_with_the_one_that_is_meant(make):
    with pytest.raises(CampaignError, match=r"mas_kg: no such key \(did you mean mass_kg\?\)"):
        make(draw='"plant.mas_kg" = { uniform = [6.0, 10.0] }')
    with pytest.raises(CampaignError, match="the mission has no such place"):
        make(draw='"wind.steady_m_s[3]" = { uniform = [6.0, 10.0] }')
    with pytest.raises(CampaignError, match="expected a key"):
        make(draw=f'"wind.steady_m_s[{"9" * 5000}]" = {{ uniform = [6.0, 10.0] }}')


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("flights = 1000000000", "at most 1,000,000"),
        ('method = "grid"', "choice or levels"),
        ('method = "list"', "points"),
        ('laws = ["mmrac", "mmrac"]', "two laws are called mmrac"),
        ('laws = ["mrac"]', "did you mean mmrac"),
        ('metrics = ["setpoint_error_finl_m"]', "did you mean setpoint_error_final_m"),
        ("flight = 10", "did you mean flights"),
        ('mission = "hovr.toml"', "drawn.toml:4: mission: hovr.toml"),
        ('airframe = "s100"', "drawn.toml:5: airframe: s100: no such airframe"),
        ('laws = ["mmrac", "mrac"]', "drawn.toml:5: laws[1]: [law] module: mrac: no such law"),
        ("stop = { width = 2.0 }", "[stop] width: expected a number < 1, got 2.0"),
        ('laws = [{ law = "mmrac", label = "../x" }]', "label"),
        (
            'method = "sobol"\nrare = { metric = "setpoint_error_max_m", limit = 2.0 }',
            'method = "random"',
        ),
    ],
)
def test_a_campaign_that_cannot_be_flown_is_said(make, head, said):
    with pytest.raises(CampaignError) as error:
        make(head)
    assert said in str(error.value)


def test_a_grid_takes_no_expectations(make):
    with pytest.raises(CampaignError, match="no sample"):
        make(
            'method = "grid"\nflights = 3\nexpect = { success = { at_least = 0.9 } }',
            draw='"plant.mass_kg" = { uniform = [6.0, 10.0], levels = 3 }',
        )


def test_a_wrong_item_is_said_once(make):
    with pytest.raises(CampaignError) as error:
        make('metrics = ["setpoint_error_finl_m"]')
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ('"plant.mass_kg"', "plant.mass_kg"),
        ('"wind.steady_m_s[0]"', '"wind.steady_m_s[00]"'),
        ('"wind.steady_m_s"', '"wind.steady_m_s[0]"'),
        ('"plant.noise.velocity_m_s"', '"plant.noise"'),
    ],
)
def test_a_quantity_that_is_drawn_twice_is_said(make, one, other):
    with pytest.raises(CampaignError, match=r"drawn\.toml.*drawn twice"):
        make(draw=f"{one} = {{ choice = [7.0] }}\n{other} = {{ choice = [7.5] }}")
    if '"' in other:
        points = f"[{{ {one} = 7.0, {other} = 7.5 }}]"
        with pytest.raises(CampaignError, match="drawn twice"):
            make(f'flights = 1\nmethod = "list"\npoints = {points}', draw="")


def test_an_interval_takes_two_flights(make):
    rare = 'rare = { metric = "setpoint_error_max_m", limit = 2.0 }'
    with pytest.raises(CampaignError, match="flights: expected 2 or more"):
        make(f"flights = 1\n{rare}")


def test_a_folder_without_a_campaign_is_said(tmp_path):
    with pytest.raises(CampaignError, match=r"a folder without a campaign.*campaign\.json"):
        read(tmp_path)


def test_a_mission_that_is_given_as_a_campaign_is_named():
    with pytest.raises(CampaignError, match="noisy_state is a mission"):
        read("noisy_state")


@pytest.mark.parametrize("method", ["random", "latin_hypercube", "sobol"])
def test_draws_depend_on_seed_and_number_alone(make, method):
    head = f'method = "{method}"'
    draws = make(head).draws
    backwards = make(head).draws
    there = [draws.quantities(n) for n in range(20)]
    assert [backwards.quantities(n) for n in reversed(range(20))] == there[::-1]
    assert len({each["plant.mass_kg"] for each in there}) == 20
    other = make(f"{head}\nseed = 2").draws
    assert other.quantities(3) != there[3]
    assert draws.noise_seed(3) == backwards.noise_seed(3) != draws.noise_seed(4)


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_a_layout_has_a_flight_in_every_part(make, method):
    draws = make(f'method = "{method}"\nflights = 16').draws
    masses = np.array([draws.quantities(n)["plant.mass_kg"] for n in range(16)])
    parts = np.floor((masses - 0.8) / 0.4 * 16).astype(int)
    assert sorted(parts) == list(range(16))


def test_layouts_miss_a_mean_by_less_than_random_draws():
    """The figures of docs/campaigns.md: four quantities, 256 flights, 20 seeds, printed with pytest -s."""
    x = np.linspace(0.0, 1.0, 100_001)
    mean = np.exp(-2.0 * (x - 0.3) ** 2).mean() ** 4
    four = tuple((SimpleNamespace(name=str(i)), None) for i in range(4))
    missed = {}
    for method in ("random", "latin_hypercube", "sobol"):
        found = []
        for seed in range(20):
            draws = Draws(method, seed, 256, four, (), True)
            parts = np.array([draws._parts(number) for number in range(256)])
            found.append(np.exp(-2.0 * (parts - 0.3) ** 2).prod(axis=1).mean() / mean - 1.0)
        missed[method] = float(np.sqrt(np.mean(np.square(found))))
    print(missed)
    assert 20.0 * missed["sobol"] < missed["random"] < 0.06
    assert missed["sobol"] < missed["latin_hypercube"] < 0.5 * missed["random"]


def test_random_draws_are_those_of_any_number_of_flights(make):
    few, many = make("flights = 5").draws, make("flights = 500").draws
    assert few.quantities(4) == many.quantities(4)


def test_a_grid_has_every_point_and_repeats_it_with_another_noise(make):
    draw = '"plant.mass_kg" = { uniform = [6.0, 10.0], levels = 2 }\n"wind.azimuth_deg" = { choice = [0.0, 90.0, 180.0] }'
    draws = make('method = "grid"\nflights = 12', draw).draws
    points = [tuple(draws.quantities(n).values()) for n in range(12)]
    assert points[:6] == [(m, a) for m in (7.0, 9.0) for a in (0.0, 90.0, 180.0)]
    assert points[6:] == points[:6]
    assert draws.noise_seed(0) != draws.noise_seed(6)
    with pytest.raises(CampaignError, match="a multiple of the 6 points"):
        make('method = "grid"\nflights = 7', draw)


def test_a_value_goes_to_its_place_and_multiplies_the_mission_s(make):
    campaign = make()
    (variant,) = campaign.variants
    drawn = campaign.draws.quantities(0)
    values = campaign.draws.values(0, drawn, variant.base)
    believed = variant.base["plant.mass_kg"]
    assert values["plant.mass_kg"] == drawn["plant.mass_kg"] * believed
    assert values["wind.steady_m_s"] == [2.0, drawn["wind.steady_m_s[1]"], 0.0]
    (setpoint,) = values["flight.setpoints"]
    assert setpoint["position_m"] == [0.5, 0.0, drawn["flight.setpoints[0].position_m[2]"]]
    assert variant.base["wind.steady_m_s"] == [2.0, 0.0, 0.0]
    assert values["flight.seed"] == campaign.draws.noise_seed(0)


def test_a_seed_that_the_file_sets_is_not_drawn(make):
    campaign = make('set = { "flight.seed" = 5 }')
    assert "flight.seed" not in campaign.draws.values(0, {}, campaign.variants[0].base)
    assert campaign.variants[0].mission.flight.seed == 5


def test_a_normal_quantity_is_not_infinite_at_the_ends():
    found = Distribution.model_validate({"normal": [0.0, 1.0]}).at(np.array([0.0, 1.0]))
    assert all(map(math.isfinite, found))


def test_a_campaign_is_called_as_its_file_whatever_it_draws(make):
    assert make().name == "drawn"


@pytest.mark.parametrize("key", ["wind.amplitude_m_s", "plant.delay_s", "wind.steady_m_s[1]"])
def test_a_relative_draw_of_a_zero_is_refused(make, key):
    with pytest.raises(CampaignError, match="which is 0"):
        make(draw=f'"{key}" = {{ uniform = [0.5, 2.0], relative = true }}\n')
    make(draw='"wind.steady_m_s" = { uniform = [0.5, 2.0], relative = true }\n')  # [2, 0, 0]


def test_a_log_normal_quantity_stays_between_its_ends():
    expected = stats.lognorm(0.3, scale=1.0)
    for low, high in ((0.8, None), (None, 1.2), (0.8, 1.2), (0.0, None)):
        ends = {name: end for name, end in (("low", low), ("high", high)) if end is not None}
        given = {"log_normal": [1.0, 0.3], **ends}
        found = np.array(Distribution.model_validate(given).at(U))
        below, above = expected.cdf(low or 0.0), expected.cdf(high or math.inf)
        np.testing.assert_allclose(found, expected.ppf(below + U * (above - below)), rtol=1e-6)


def test_an_end_that_a_log_normal_quantity_never_comes_below_leaves_nothing():
    with pytest.raises(ValueError, match="above low, -inf"):
        Distribution.model_validate({"log_normal": [1.0, 0.3], "high": 0.0})
