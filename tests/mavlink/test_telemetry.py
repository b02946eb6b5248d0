"""Telemetry, read by pymavlink: each field as the standard has it, worked out by hand."""

from __future__ import annotations

import math
import struct

import pymavlink.dialects.v20.all as mavlink
import pytest

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.rotations import from_euler
from fcu.mavlink import setpoints
from fcu.mavlink import telemetry as tm
from fcu.mavlink.definitions import LandedState, SystemStatus
from fcu.mavlink.framing import framed
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.px4_modes import AutoMode, MainMode
from fcu.mavlink.setpoints import Target, target_of

SPIN = Rotors(1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
# The nose to the North, the right side down by 30 degrees.
NOSE_NORTH_RIGHT_DOWN = from_euler(math.radians(30.0), 0.0, math.radians(90.0))
HALF = math.radians(15.0)
PLACE = Geodetic(47.397742, -8.545594, 489.4)
V_E = Vec3(4.0, 5.0, 6.0)  # m/s


def read(message):
    """The message, by pymavlink."""
    (m,) = mavlink.MAVLink(None).parse_buffer(bytearray(framed(*message, 0, 3, 1)))
    return m


def fields(m, *names):
    return tuple(getattr(m, name) for name in names)


def near(*values):
    return pytest.approx(values, rel=1e-6, abs=1e-6)


# --- identity and status


@pytest.mark.parametrize(("armed", "base_mode"), [(False, 1 | 4 | 8), (True, 1 | 4 | 8 | 128)])
def test_heartbeat_is_that_of_a_px4_octocopter(armed, base_mode):
    m = read(tm.heartbeat(14, 12, armed, MainMode.AUTO, AutoMode.LAND, SystemStatus.ACTIVE, 4 | 8))
    assert fields(m, "type", "autopilot", "base_mode", "custom_mode", "system_status") == (
        14, 12, base_mode, 4 << 16 | 6 << 24, 4,
    )  # fmt: skip
    assert m.mavlink_version == 3


def test_offboard_mode_number_is_px4s():
    assert read(tm.heartbeat(14, 0, True, MainMode.OFFBOARD, 0, 4)).custom_mode == 6 << 16


def test_sys_status_counts_in_thousandths_hundredths_and_millivolts():
    m = read(tm.sys_status(0b111, 0b110, 0b100, 0.25, 24.5, 31.25, 0.8, 5))
    assert fields(
        m, "onboard_control_sensors_present", "onboard_control_sensors_enabled",
        "onboard_control_sensors_health", "load", "voltage_battery", "current_battery",
        "battery_remaining", "errors_comm",
    ) == (7, 6, 4, 250, 24500, 3125, 80, 5)  # fmt: skip


def test_what_a_battery_does_not_know_is_said_as_the_standard_says_it():
    nan = math.nan
    m = read(tm.sys_status(0, 0, 0, 3.0, nan, nan, nan, 0))
    assert fields(m, "load", "voltage_battery", "current_battery", "battery_remaining") == (
        1000, 65535, -1, -1,
    )  # fmt: skip
    m = read(tm.battery_status(nan, nan, nan, nan, nan, 6, 0, nan))
    assert fields(m, "current_battery", "current_consumed", "energy_consumed") == (-1, -1, -1)
    assert fields(m, "battery_remaining", "time_remaining", "temperature") == (-1, 0, 32767)
    assert m.voltages == [65535] * 10


def test_battery_status_is_of_equal_cells():
    m = read(tm.battery_status(24.0, 12.5, 1.5, 0.42, 600.0, 6, 2, 123_400.0))
    assert m.voltages == [4000] * 6 + [65535] * 4
    assert fields(m, "current_battery", "current_consumed", "energy_consumed") == (1250, 1500, 1234)
    assert fields(m, "battery_remaining", "time_remaining", "charge_state") == (42, 600, 2)
    assert fields(m, "type", "battery_function") == (1, 1)


@pytest.mark.parametrize(
    ("cells", "volts", "first", "more"),
    [
        (1, 4.2, [4200] + [65535] * 9, [0] * 4),
        (12, 48.0, [4000] * 10, [4000, 4000, 0, 0]),
        (14, 56.0, [4000] * 10, [4000] * 4),
        (16, 60.0, [60000] + [65535] * 9, [0] * 4),
        (20, 80.0, [65534, 80000 - 65534] + [65535] * 8, [0] * 4),
    ],
)
def test_more_cells_than_battery_status_has_are_told_as_the_standard_says(
    cells, volts, first, more
):
    m = read(tm.battery_status(volts, 0.0, 0.0, 1.0, math.nan, cells, 1, 0.0))
    assert (m.voltages, m.voltages_ext) == (first, more)


def test_landed_state_and_times():
    assert read(tm.extended_state(LandedState.IN_AIR)).landed_state == 2
    m = read(tm.system_time(1.5e9, 2.5))
    assert fields(m, "time_unix_usec", "time_boot_ms") == (1_500_000_000_000_000, 2500)


# --- attitude and position


def test_attitude_is_of_forward_right_down_in_north_east_down():
    m = read(tm.attitude_quaternion(1.5, NOSE_NORTH_RIGHT_DOWN, Vec3(0.25, 0.5, 0.75)))
    assert m.time_boot_ms == 1500
    assert fields(m, "q1", "q2", "q3", "q4") == near(math.cos(HALF), math.sin(HALF), 0.0, 0.0)
    assert fields(m, "rollspeed", "pitchspeed", "yawspeed") == (0.25, -0.5, -0.75)


@pytest.mark.parametrize(
    ("turned", "angles"),  # of FLU from ENU; as roll, pitch, yaw of FRD in NED
    [
        ((0.5, 0.0, math.pi / 2), (0.5, 0.0, 0.0)),  # right down
        ((0.0, 0.5, math.pi / 2), (0.0, -0.5, 0.0)),  # nose down
        ((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2)),  # to the East
        ((0.0, 0.0, math.pi), (0.0, 0.0, -math.pi / 2)),  # to the West
    ],
)
def test_euler_angles_are_of_forward_right_down_in_north_east_down(turned, angles):
    m = read(tm.attitude_euler(2.0, from_euler(*turned), Vec3(0.25, 0.5, 0.75)))
    assert fields(m, "roll", "pitch", "yaw") == near(*angles)
    assert fields(m, "time_boot_ms", "rollspeed", "pitchspeed", "yawspeed") == (
        2000, 0.25, -0.5, -0.75,
    )  # fmt: skip


def test_local_position_is_north_east_down():
    m = read(tm.local_position(2.0, Vec3(1.0, 2.0, 3.0), V_E))
    assert fields(m, "x", "y", "z", "vx", "vy", "vz") == (2.0, 1.0, -3.0, 5.0, 4.0, -6.0)


def test_global_position_counts_in_degE7_millimetres_and_centidegrees():
    m = read(tm.global_position(2.0, PLACE, 12.345, V_E, math.radians(100.0)))
    assert fields(m, "time_boot_ms", "lat", "lon", "alt", "relative_alt") == (
        2000, 473977420, -85455940, 489400, 12345,
    )  # fmt: skip
    assert fields(m, "vx", "vy", "vz", "hdg") == (500, 400, -600, 35000)
    assert read(tm.global_position(0.0, PLACE, 0.0, V_E, math.nan)).hdg == 65535
    due_north = tm.global_position(0.0, PLACE, 0.0, V_E, math.radians(90.001))
    assert read(due_north).hdg == 0  # not 36000


def test_gps_has_a_fix_and_the_course_over_ground():
    m = read(tm.gps_raw(2.0, PLACE, Vec3(-3.0, 0.0, 1.0)))  # to the West
    assert fields(m, "time_usec", "lat", "lon", "alt") == (2_000_000, 473977420, -85455940, 489400)
    assert fields(m, "vel", "cog") == (300, 27000)
    assert m.fix_type >= 3
    assert m.satellites_visible >= 12
    assert read(tm.gps_raw(2.0, PLACE, Vec3(0.0, 0.0, 1.0))).cog == 65535  # no course


def test_home_and_origin():
    m = read(tm.home_position(PLACE, Vec3(1.0, 2.0, 3.0)))
    assert fields(m, "latitude", "longitude", "altitude") == (473977420, -85455940, 489400)
    assert fields(m, "x", "y", "z") == (2.0, 1.0, -3.0)
    m = read(tm.gps_global_origin(PLACE))
    assert fields(m, "latitude", "longitude", "altitude") == (473977420, -85455940, 489400)


def test_altitudes_are_upwards():
    m = read(tm.altitude(1.0, 500.0, 12.0, 10.0))
    assert fields(m, "time_usec", "altitude_amsl", "altitude_local", "altitude_relative") == (
        1_000_000, 500.0, 12.0, 10.0,
    )  # fmt: skip


def test_vfr_hud_has_the_heading_from_north_and_per_cent_of_throttle():
    m = read(tm.vfr_hud(7.0, 5.0, math.pi, 0.42, 500.0, -1.5))
    assert fields(m, "airspeed", "groundspeed", "heading", "throttle", "alt", "climb") == (
        7.0, 5.0, 270, 42, 500.0, -1.5,
    )  # fmt: skip


def test_odometry_is_of_forward_right_down_in_north_east_down():
    m = read(
        tm.odometry(1.0, Vec3(1.0, 2.0, 3.0), NOSE_NORTH_RIGHT_DOWN, V_E, Vec3(0.25, 0.5, 0.75))
    )
    assert fields(m, "time_usec", "frame_id", "child_frame_id") == (1_000_000, 1, 12)
    assert fields(m, "x", "y", "z", "vx", "vy", "vz") == (2.0, 1.0, -3.0, 4.0, -5.0, -6.0)
    assert tuple(m.q) == near(math.cos(HALF), math.sin(HALF), 0.0, 0.0)
    assert fields(m, "rollspeed", "pitchspeed", "yawspeed") == (0.25, -0.5, -0.75)
    assert math.isnan(m.pose_covariance[0])  # not known
    assert math.isnan(m.velocity_covariance[0])


def test_estimator_status_has_no_accuracy():
    m = read(tm.estimator_status(1.0, 63))
    assert fields(m, "time_usec", "flags") == (1_000_000, 63)
    assert math.isnan(m.pos_horiz_accuracy)


# --- setpoints in force


def test_the_setpoint_in_force_repeats_what_came():
    numbers = Target(*range(11))
    m = read(setpoints.position_target(1.0, 8, 2048, numbers))
    assert fields(m, "time_boot_ms", "coordinate_frame", "type_mask") == (1000, 8, 2048)
    assert fields(
        m, "x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"
    ) == tuple(range(11))
    m = read(setpoints.position_target_global(1.0, 6, 2048, PLACE, numbers))
    assert fields(m, "coordinate_frame", "type_mask", "lat_int", "lon_int") == (
        6, 2048, 473977420, -85455940,
    )  # fmt: skip
    assert m.alt == pytest.approx(489.4)
    assert fields(m, "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate") == tuple(
        range(3, 11)
    )


def test_a_setpoint_made_on_board_is_north_east_down():
    wanted = Setpoint(Vec3(1.0, 2.0, 3.0), V_E, Vec3(7.0, 8.0, 9.0), math.pi / 2, 0.5)
    m = read(setpoints.position_target(1.0, 1, 0, target_of(wanted)))
    assert fields(m, "coordinate_frame", "type_mask", "x", "y", "z") == (1, 0, 2.0, 1.0, -3.0)
    assert fields(m, "vx", "vy", "vz", "afx", "afy", "afz") == (5.0, 4.0, -6.0, 8.0, 7.0, -9.0)
    assert fields(m, "yaw", "yaw_rate") == (0.0, -0.5)
    m = read(setpoints.position_target_global(1.0, 5, 0, PLACE, target_of(wanted)))
    assert fields(m, "coordinate_frame", "lat_int", "vx", "yaw_rate") == (5, 473977420, 5.0, -0.5)


@pytest.mark.parametrize(("thrust", "field"), [(0.5, 0.5), (1.5, 1.0), (-1.0, 0.0)])
def test_attitude_target_has_thrust_between_zero_and_one(thrust, field):
    m = read(
        setpoints.attitude_target(0.0, 7, NOSE_NORTH_RIGHT_DOWN, Vec3(0.25, 0.5, 0.75), thrust)
    )
    assert fields(m, "thrust", "type_mask") == (field, 7)
    assert fields(m, "body_roll_rate", "body_pitch_rate", "body_yaw_rate") == (0.25, -0.5, -0.75)
    assert tuple(m.q) == near(math.cos(HALF), math.sin(HALF), 0.0, 0.0)


# --- rotors and air


def test_rotor_speeds_are_signed_by_spin():
    m = read(tm.rotors(1.25, Rotors(*[float(i) for i in range(8)]), SPIN))
    assert fields(m, "time_usec", "active") == (1_250_000, 0xFF)
    assert m.actuator[:9] == [0.0, -1.0, 2.0, -3.0, 4.0, -5.0, 6.0, -7.0, 0.0]


def test_servo_outputs_are_pulses_of_one_to_two_milliseconds():
    m = read(tm.servo_output_raw(1.25, [0.0, 1.0, 0.5, 0.25, 0.0, 0.0, 0.0, 0.125]))
    assert fields(m, *(f"servo{i}_raw" for i in range(1, 10))) == (
        1000, 2000, 1500, 1250, 1000, 1000, 1000, 1125, 0,
    )  # fmt: skip
    assert fields(m, "time_usec", "port") == (1_250_000, 0)


def test_esc_status_and_info_are_laid_out_as_the_standard_has_them():
    # No dialect here has them: 8-byte fields first, then 4, 2, 1.
    status = tm.esc_status(1.25, 4, [1200.4, -1200.6, 0.0, 1.0], [24.0] * 4, [1.5, 2.5, 0.0, 0.0])
    assert status.definition.id == 291
    assert status.payload == struct.pack(
        "<Q4i4f4fB", 1_250_000, 1200, -1201, 0, 1, *[24.0] * 4, 1.5, 2.5, 0.0, 0.0, 4
    )
    info = tm.esc_info(1.25, 4, 77, 8, 0xFF)
    unknown = 2**15 - 1
    assert info.definition.id == 290
    assert info.payload == struct.pack(
        "<Q4IH4H4hBBBB", 1_250_000, 0, 0, 0, 0, 77, 0, 0, 0, 0, *[unknown] * 4, 4, 8, 0, 0xFF
    )


def test_wind_blows_towards_in_one_message_and_from_in_the_other():
    westerly = Vec3(3.0, -4.0, 0.5)  # to the East and South, rising
    m = read(tm.wind_cov(1.25, westerly, 0.25, 0.04, 30.0))
    assert fields(m, "time_usec", "wind_x", "wind_y", "wind_z") == (1_250_000, -4.0, 3.0, -0.5)
    assert fields(m, "var_horiz", "var_vert", "wind_alt") == near(0.5, 0.2, 30.0)
    m = read(tm.wind(westerly))
    assert m.direction == pytest.approx(360.0 - math.degrees(math.atan2(3.0, 4.0)))
    assert fields(m, "speed", "speed_z") == near(5.0, -0.5)


@pytest.mark.parametrize(
    ("v_air_E", "direction"),
    [
        ((0.0, -1.0), 0.0), ((1e-17, -1.0), 0.0), ((-1.0, 0.0), 90.0), ((0.0, 1.0), 180.0),
        ((1.0, 0.0), 270.0), ((0.0, 0.0), 180.0),
    ],
)  # fmt: skip
def test_wind_comes_from_a_direction_below_360_degrees(v_air_E, direction):
    assert read(tm.wind(Vec3(*v_air_E, 0.0))).direction == pytest.approx(direction)


def test_values_by_name():
    m = read(tm.named_value_float(1.25, "m_hat", 8.25))
    assert fields(m, "time_boot_ms", "name", "value") == (1250, "m_hat", 8.25)
    m = read(tm.debug_float_array(1.25, "mmrac", 2, [float(i) for i in range(60)]))
    assert fields(m, "time_usec", "name", "array_id") == (1_250_000, "mmrac", 2)
    assert m.data == [float(i) for i in range(58)]
