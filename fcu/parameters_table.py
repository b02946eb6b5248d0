"""Every parameter of the vehicle that is no number of the law: name, unit, range, what it does.

Names, meanings and units are PX4's where PX4 has the parameter, so that a ground station's own
description fits; defaults are this vehicle's. REF_ and MR_ are this vehicle's own.
"""

from __future__ import annotations

from typing import NamedTuple


class Parameter(NamedTuple):
    """What a parameter is. Every value is a REAL32 on the wire."""

    name: str  # at most 16 characters
    unit: str  # empty: a number without unit
    low: float
    high: float
    default: float
    sentence: str
    read_only: bool = False
    disarmed_only: bool = False
    values: tuple[float, ...] | None = None  # if only these are allowed


P = Parameter

VEHICLE: tuple[Parameter, ...] = (
    # modes
    P("MIS_TAKEOFF_ALT", "m", 0.5, 80.0, 2.5, "height of a take-off that names none"),
    P("RTL_RETURN_ALT", "m", 0.0, 150.0, 10.0, "height above home of the way back"),
    P("MPC_XY_CRUISE", "m/s", 0.5, 20.0, 5.0, "speed across of modes that lead the vehicle"),
    P("MPC_XY_VEL_MAX", "m/s", 0.5, 20.0, 12.0, "greatest speed across that is asked for"),
    P("MPC_Z_VEL_MAX_UP", "m/s", 0.5, 8.0, 3.0, "greatest speed of a climb"),
    P("MPC_Z_VEL_MAX_DN", "m/s", 0.5, 4.0, 1.5, "greatest speed of a descent"),
    P("MPC_ACC_HOR", "m/s^2", 0.5, 8.0, 3.0, "acceleration across of modes that lead the vehicle"),
    P("MPC_ACC_UP_MAX", "m/s^2", 0.5, 6.0, 3.0, "vertical acceleration of those modes, up and down"),
    P("MPC_LAND_SPEED", "m/s", 0.3, 1.5, 0.7, "speed of a landing near the ground"),
    P("MPC_MAN_Y_MAX", "deg/s", 1.0, 180.0, 60.0, "yaw rate at full stick in position mode"),
    P("REF_STEP_E", "m", -50.0, 50.0, 5.0, "step of the reference generator to the east"),
    P("REF_STEP_N", "m", -50.0, 50.0, 0.0, "step of the reference generator to the north"),
    P("REF_STEP_U", "m", -20.0, 20.0, 0.0, "step of the reference generator upwards"),
    P("REF_STEP_T", "s", 1.0, 120.0, 10.0, "time at each end of that step"),
    P("REF_8_LEN", "m", 1.0, 100.0, 10.0, "length of the generator's figure-eight, to the east"),
    P("REF_8_WIDTH", "m", 1.0, 100.0, 5.0, "width of that figure-eight, to the north"),
    P("REF_8_SPEED", "m/s", 0.1, 10.0, 3.0, "speed at which that figure-eight crosses itself"),
    # setpoints of a script, and their loss
    P("MR_SP_DIST", "m", 1.0, 10000.0, 100.0, "setpoints farther away are flown at this distance"),
    P("MR_SP_BELOW", "m", 0.0, 10000.0, 1.0, "setpoints farther below home are flown there"),
    P("COM_OF_LOSS_T", "s", 0.1, 60.0, 1.0, "age of the last setpoint at which offboard is lost"),
    P(
        "COM_OBL_RC_ACT", "", 0.0, 7.0, 0.0,
        "then: 0 position, 3 return, 4 land, 5 hold, 6 terminate, 7 disarm",
        values=(0.0, 3.0, 4.0, 5.0, 6.0, 7.0),
    ),
    P("COM_RC_LOSS_T", "s", 0.1, 35.0, 0.5, "time for which a joystick's last word is flown"),
    # arming
    P("COM_DISARM_LAND", "s", -1.0, 60.0, 2.0, "time on the ground until it disarms; below 0 never"),
    P(
        "COM_DISARM_PRFLT", "s", -1.0, 60.0, 10.0,
        "time until it disarms if it does not take off; below 0 never",
    ),
    # battery, fractions of full
    P("BAT_LOW_THR", "", 0.0, 1.0, 0.15, "charge at which the battery is low"),
    P("BAT_CRIT_THR", "", 0.0, 1.0, 0.07, "charge at which it is critical"),
    P("BAT_EMERGEN_THR", "", 0.0, 1.0, 0.05, "charge at which it is an emergency"),
    P("BAT1_CAPACITY", "mAh", 100.0, 100000.0, 15000.0, "of a full battery, for the time left"),
    P("BAT1_N_CELLS", "", 1.0, 16.0, 6.0, "cells in series, as the plant has them", True),
    # what ground stations ask for
    P("COM_DL_LOSS_T", "s", 5.0, 300.0, 10.0, "no effect: see NAV_DLL_ACT", True),
    P("NAV_DLL_ACT", "", 0.0, 6.0, 0.0, "no action on the loss of a ground station", True),
    P("SYS_FAILURE_EN", "", 0.0, 1.0, 0.0, "failures cannot be injected by command", True),
    P("SYS_AUTOSTART", "", 0.0, 9999999.0, 8001.0, "airframe: octocopter x", True),
    P("MAV_SYS_ID", "", 1.0, 250.0, 1.0, "MAVLink system, set at the start", True),
    P("MAV_TYPE", "", 0.0, 45.0, 14.0, "MAVLink type: octocopter", True),
)  # fmt: skip

# Of each pair the first must stay below the second.
BELOW: tuple[tuple[str, str], ...] = (
    ("BAT_EMERGEN_THR", "BAT_CRIT_THR"),
    ("BAT_CRIT_THR", "BAT_LOW_THR"),
    ("MR_T_MIN", "MR_T_MAX"),
    ("MR_M_MIN", "MR_M_MAX"),
    ("MR_J_MIN", "MR_J_MAX"),
)

# Of each pair the first must not be above the second.
NOT_ABOVE: tuple[tuple[str, str], ...] = (("MR_GRD_M_MIN", "MR_GRD_M_MAX"),)
