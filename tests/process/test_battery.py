"""The battery over the plant link, and in the recording of a flight."""

from __future__ import annotations

import math
import os

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

import gcs_tools
from fcu.interface.airframe import believed
from fcu.interface.handover import GRANT
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.buffers import columns, size
from fcu.mavlink.plant_link import PlantCodec
from gcs_tools.recording import reader as recording
from sitl_plant.physics.types import PlantRecord
from tests.patience import PATIENCE_S
from tests.process.script import Script

BATTERY = [name for name in columns(PlantRecord) if name.startswith("battery.")]


@pytest.fixture
def codec(instance):
    return PlantCodec(instance + 1, believed()[0].spin)


def heard(link, codec):
    """Time (us), whether it is a keep-alive, and the battery in the plant's next datagram."""
    codec.battery = None
    while True:
        assert link.wait(PATIENCE_S), "nothing heard"
        if (datagram := link.receive()) is not None:
            time_us = codec.parse_state(datagram, np.zeros(size(VehicleState)))
            return time_us, codec.is_hold(datagram), codec.battery


def test_ten_times_a_second_and_while_time_stands(start, bound, instance, codec):
    link, (reads, grants) = bound("fcu_plant", "plant"), os.pipe()
    try:
        plant = start(
            "sitl_plant", "--instance", instance, "--speed", "max",
            "--control-fd", reads, pass_fds=(reads,),
        )  # fmt: skip
        plant.says('"ready"')
        for _ in range(2):
            time_us, held, battery = heard(link, codec)
            assert (time_us, held) == (0, True)
            assert battery == pytest.approx((25.2, 0.6, 0.0, 1.0, 0.0), abs=0.02)  # 15 W
        os.write(grants, GRANT.pack(151))
        at, full = [], np.ones(size(RotorCommand))
        while True:
            time_us, held, battery = heard(link, codec)
            if held and time_us == 0:
                continue  # was on its way
            if held:
                break
            if battery is not None:
                at.append(time_us)
            link.send(codec.pack_controls(time_us, full, True, True))
        assert at == [0, 100_000, 200_000, 300_000]
        assert time_us == 302_000
        assert battery is not None
        assert battery.current > 100.0  # at full speed
        assert battery.voltage < 24.0
        os.close(grants)
        grants = -1
        assert plant.wait() == 0
    finally:
        os.close(reads)
        if grants >= 0:
            os.close(grants)


def test_the_truth_is_the_same_over_the_wire_and_in_process(tmp_path):
    settings = ["flight.duration_s=3", "plant.battery_ah=5", "plant.battery_remaining=0.5"]
    rows = []
    for name in ("wire", "in_process"):
        flown = gcs_tools.fly(
            "paper_nominal", settings=settings, in_process=name == "in_process",
            out=tmp_path / name, figure="never",
        )  # fmt: skip
        assert flown.error is None
        rows.append(recording.read(tmp_path / name / "flight.mcap").plant)
    assert rows[0].rows.tobytes() == rows[1].rows.tobytes()
    voltage, current, drawn, remaining, energy = (rows[0][name] for name in BATTERY)
    assert (drawn[0], remaining[0], energy[0]) == (0.0, 0.5, 0.0)
    assert remaining[-1] == pytest.approx(0.5 - drawn[-1] / 5.0, abs=1e-12)
    assert drawn[-1] == pytest.approx(np.sum(current[:-1]) / 500.0 / 3600.0, rel=1e-9)
    assert energy[-1] == pytest.approx(np.sum(voltage[:-1] * current[:-1]) / 500.0, rel=1e-9)
    assert 1000.0 < energy[-1] / 3.0 < 2500.0  # W, hovering and climbing


SMALL_BATTERY = """title = "A battery that is all but empty."
[flight]
duration_s = 60.0
ground_z_m = 0.0
start = { on_ground = true }
items = [{ kind = "take_off", height_m = 20.0 }]
[plant]
battery_ah = 1.5
battery_remaining = 0.16
"""
RETURN, LAND = 4 << 16 | 5 << 24, 4 << 16 | 6 << 24  # HEARTBEAT.custom_mode
ARM, TAKE_OFF = 400, 22


@pytest.mark.slow
@pytest.mark.parametrize(("action", "modes"), [(0, []), (2, [LAND]), (3, [RETURN, LAND])])
def test_a_battery_that_runs_low_in_flight_is_acted_on(start, instance, tmp_path, action, modes):
    """A battery of 1.5 A h, from 16 %: it is an emergency 12 s into the flight."""
    params = tmp_path / "low.params"
    params.write_text(f"COM_LOW_BAT_ACT = {action}.0\nMIS_TAKEOFF_ALT = 20.0\n")
    mission = tmp_path / "small_battery.toml"
    mission.write_text(SMALL_BATTERY)
    up = start(
        "gcs_tools", "up", mission, "--instance", instance, "--speed", 4, "--params", params,
        "--no-publish",
    )  # fmt: skip
    up.says("ready")
    script = Script(instance)
    try:
        script.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)
        assert script.command(ARM, 1) == mavlink.MAV_RESULT_ACCEPTED
        assert script.command(TAKE_OFF, 0, 0, 0, math.nan, math.nan, math.nan, math.nan) == 0
        texts, seen, statuses = [], [], set()
        for message in script.messages():
            if message.get_type() == "STATUSTEXT":
                texts.append(message.text)
            elif message.get_type() == "HEARTBEAT" and message.custom_mode in (RETURN, LAND):
                seen += [message.custom_mode] if message.custom_mode not in seen else []
                statuses.add(message.system_status)
            done = [text for text in texts if text.startswith("Battery emergency")]
            if done and len(seen) == len(modes):
                break
    finally:
        script.close()
    assert [text.split(":")[0] for text in texts if text.startswith("Battery")] == [
        "Battery low", "Battery critical", "Battery emergency",
    ]  # fmt: skip
    assert seen == modes
    assert statuses == ({mavlink.MAV_STATE_CRITICAL} if modes else set())
    assert up.interrupted() == 0


def test_a_verdict_tells_of_a_battery_that_runs_low(tmp_path):
    flown = gcs_tools.fly(
        "paper_nominal", in_process=True, record="none", figure="never", out=tmp_path,
        settings=["plant.battery_ah=1.5", "plant.battery_remaining=0.16"],
    )  # fmt: skip
    told = [warned.text.split(":")[0] for warned in flown.warnings]
    assert [text for text in told if text.startswith("Battery")] == [
        "Battery low", "Battery critical", "Battery emergency",
    ]  # fmt: skip
