"""Values that one process hands to another: exact to the bit, or refused with file and name."""

from __future__ import annotations

import json
import math

import pytest

from fcu.interface.airframe import believed
from fcu.interface.handover import HandoverError, load, save
from fcu.laws import loader
from fcu.process.configuration import ConfigurationError, read_settings
from fcu.process.settings import Settings, settings

SETTINGS = settings(*believed(), 500.0)


@pytest.fixture
def file(tmp_path):
    save(tmp_path / "settings.json", SETTINGS)
    return tmp_path / "settings.json"


def changed(file, name, value):
    told = json.loads(file.read_text())
    assert name in told["Settings"]
    told["Settings"][name] = value
    file.write_text(json.dumps(told))


def test_a_value_comes_back_to_the_bit(file):
    assert load(file, Settings) == SETTINGS


@pytest.mark.parametrize("value", ["1", True, None, [1.0], math.nan, math.inf])
def test_what_is_no_finite_number_is_refused_by_its_name(file, value):
    changed(file, "law.f_m", value)
    with pytest.raises(HandoverError, match=r"settings\.json: .*law\.f_m: expected a .*number"):
        load(file, Settings)


def test_a_number_out_of_range_is_refused_with_the_file(file):
    changed(file, "law.f_m", 1e300)
    with pytest.raises(ConfigurationError, match=r"settings\.json: f_m: expected a value from"):
        read_settings(loader.load(), file, 500.0)
