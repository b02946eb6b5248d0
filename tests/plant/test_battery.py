"""The battery: power from rotor speeds, current and voltage from power, charge from current."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.messages import Battery
from fcu.kernel.algebra import Rotors
from fcu.kernel.buffers import columns, size, to_buffer
from sitl_plant.physics import battery, tick
from sitl_plant.physics.parameters import start_state
from sitl_plant.physics.types import PlantRecord

ALL = Rotors(*[1.0] * 8)
FULL = battery.BatteryState(0.0, 0.0)
STOPPED = Rotors(*[0.0] * 8)


def hovering(params, mass):
    """Rotor speeds (rad/s) that carry `mass` (kg)."""
    return Rotors(*[math.sqrt(mass * 9.81 / 8.0 / params.airframe.c_T.r1)] * 8)


def test_power_is_the_blades_torque_times_speed_over_efficiency(plant):
    params = plant()
    Omega = hovering(params, 8.0)
    blades = 0.0159 * (8.0 * 9.81) * Omega.r1  # k_Q times thrust, times speed
    assert blades == pytest.approx(431.6, abs=0.1)
    electrical = battery.power(params.battery, params.airframe, Omega, ALL)
    assert electrical == pytest.approx(blades / 0.375 + 15.0, rel=1e-12)
    assert battery.power(params.battery, params.airframe, STOPPED, ALL) == 15.0


def test_hover_power_at_nine_and_a_half_kilograms_is_the_makers(plant):
    params = plant()
    watts = battery.power(params.battery, params.airframe, hovering(params, 9.5), ALL)
    assert watts == pytest.approx(1500.0, rel=0.01)


def test_a_rotor_that_lost_its_torque_takes_no_power(plant):
    params = plant()
    Omega = hovering(params, 8.0)
    seven = battery.power(params.battery, params.airframe, Omega, ALL._replace(r3=0.0))
    eight = battery.power(params.battery, params.airframe, Omega, ALL)
    assert (seven - 15.0) / (eight - 15.0) == pytest.approx(7.0 / 8.0)


def test_hovering_empties_it_in_fifteen_to_twenty_minutes(plant):
    params = plant()
    buffer, drawn = to_buffer(start_state(params)), np.zeros(2)
    given, row = to_buffer(params), np.zeros(size(PlantRecord))
    u = np.full(8, start_state(params).Omega.r1 / params.airframe.Omega_max.r1)
    at = columns(PlantRecord).index("battery.voltage")
    seen, t = [], 0.0
    while not seen or seen[-1].remaining > 0.0:
        tick.observe(given, buffer, drawn, t, buffer, row)
        seen.append(Battery(*row[at : at + 5].tolist()))
        tick.advance(given, buffer, drawn, u, t, 1000)  # steps of 1 ms
        t += 1.0
    assert 15.0 < t / 60.0 < 20.0
    assert seen[-1].drawn_Ah == pytest.approx(15.0, abs=0.02)
    assert seen[-1].energy_J / 3600.0 == pytest.approx(330.0, rel=0.05)  # 6 cells of 3.7 V: 333 W h
    assert seen[0].voltage == pytest.approx(25.2 - 0.018 * seen[0].current)
    voltages = [b.voltage for b in seen]
    assert voltages == sorted(voltages, reverse=True)
    # charge and energy are the integrals of current and power
    currents = np.array([b.current for b in seen[:-1]])
    assert seen[-1].drawn_Ah * 3600.0 == pytest.approx(currents.sum(), rel=1e-9)
    powers = currents * np.array(voltages[:-1])
    assert seen[-1].energy_J == pytest.approx(powers.sum(), rel=1e-9)


def test_what_it_delivers_is_what_is_asked(plant):
    params = plant()
    for speed in (0.0, 200.0, 350.0, 552.2):
        Omega = Rotors(*[speed] * 8)
        now = battery.report(params.battery, params.airframe, Omega, ALL, FULL)
        asked = battery.power(params.battery, params.airframe, Omega, ALL)
        assert now.voltage * now.current == pytest.approx(asked, rel=1e-12)
        assert now.voltage > 0.5 * 25.2  # of the two roots, the one with less current


def test_asked_for_more_than_it_has_it_gives_the_most_it_can(plant):
    params = plant()
    weak = params.battery._replace(resistance=0.1)
    now = battery.report(weak, params.airframe, Rotors(*[552.2] * 8), ALL, FULL)
    assert (now.voltage, now.current) == pytest.approx((12.6, 126.0))


@pytest.mark.parametrize(
    ("remaining", "cell"),
    [(1.0, 4.20), (0.9, 4.11), (0.8, 4.02), (0.5, 3.835), (0.1, 3.69), (0.05, 3.61), (0.0, 3.27)],
)
def test_rest_voltage_is_the_charts(plant, remaining, cell):
    params = plant(battery_remaining=remaining)
    assert battery.rest_voltage(params.battery, remaining) == pytest.approx(6.0 * cell)


def test_an_empty_battery_reports_0_and_goes_on(plant):
    params = plant(battery_ah=1.0, battery_remaining=0.25)
    state = battery.BatteryState(1000.0, 22000.0)  # more than the 900 C that were left
    now = battery.report(params.battery, params.airframe, hovering(params, 8.0), ALL, state)
    assert (now.remaining, now.drawn_Ah, now.energy_J) == (0.0, 1000.0 / 3600.0, 22000.0)
    assert now.voltage * now.current == pytest.approx(1166.0, rel=0.01)
    later = battery.drained(state, now, 0.5)
    assert later.charge == 1000.0 + 0.5 * now.current


def test_a_mission_chooses_capacity_and_charge(plant):
    params = plant(battery_ah=10.0, battery_remaining=0.4)
    now = battery.report(params.battery, params.airframe, STOPPED, ALL, FULL)
    assert (now.remaining, now.drawn_Ah) == (0.4, 0.0)
    half = battery.BatteryState(0.2 * 36000.0, 0.0)
    now = battery.report(params.battery, params.airframe, STOPPED, ALL, half)
    assert now.remaining == pytest.approx(0.2)
