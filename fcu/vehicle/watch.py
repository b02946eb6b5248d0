"""The looks of a StateMachine at which nothing happens, for compiled code.

A vehicle is looked at 50 times a second: whether it stands on the ground, whether what it flies
leads into it. Nearly always nothing comes of it. `quiet_look` does a look of that kind as
`StateMachine.observe` would do it, and leaves every other to it. Times: simulation time, us.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, minimum
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.reference_model import carried
from fcu.vehicle import landing
from fcu.vehicle.landing import (
    LandedDetector,
    LandedState,
    TouchdownDetector,
    TouchdownState,
)
from fcu.vehicle.plans import STILL, PlanLimits, at, pose_at, pose_of, stop

LOOK_US = 20_000  # between looks at whether it has landed, and at the timers of arming


class Given(NamedTuple):
    """What looks go by, and the StateMachine alone changes. 0 and 1: no and yes."""

    until_us: float  # when the piece of a plan that is flown ends
    deadline_us: float  # the first microsecond at which the script may be lost
    armed: float
    scripted: float  # armed, and in offboard mode
    lands: float  # for itself, or for a script
    python: float  # every look is the StateMachine's
    approach: float  # how the script's setpoint is flown
    asked: Setpoint  # by the script
    asked_us: float  # when that took effect
    limits: PlanLimits
    c_T: Rotors  # thrust coefficients, N s^2, believed
    anywhere_us: float  # as in `landing.touches`


class Watch(NamedTuple):
    """What looks change, and what they go by."""

    look_us: float  # when the next one is due
    wake_us: float  # nothing happens by itself before
    landed: LandedState
    touchdown: TouchdownState
    given: Given


_unpack_measured, _unpack_setpoint = unpacker(VehicleState), unpacker(Setpoint)
_unpack, _unpack_wake = unpacker(Watch), unpacker(Watch, "wake_us")
_pack_look, _pack_wake = packer(Watch, "look_us"), packer(Watch, "wake_us")
_pack_landed, _pack_touchdown = packer(Watch, "landed"), packer(Watch, "touchdown")


@kernel
def quiet_look(watch_buffer, state, setpoint, age, t_us):
    """Whether `StateMachine.observe` has nothing to do at this tick; a look that is due is done then.

    watch_buffer : float64[size(Watch)]; as it was where False is returned.
    state : float64[size(VehicleState)], measured.
    setpoint : float64[size(Setpoint)], the setpoint that is flown, `age` seconds after it took
    effect; whatever stands there while the vehicle is disarmed.  t_us : a float.
    """
    if t_us < _unpack_wake(watch_buffer):
        return True
    watch = _unpack(watch_buffer)
    given = watch.given
    other = t_us < watch.look_us or t_us >= given.until_us or t_us >= given.deadline_us
    if other or given.python != 0.0:
        return False
    measured = _unpack_measured(state)
    landed, touchdown = landing.stands(watch.landed, given.c_T, measured, t_us), watch.touchdown
    if landed.landed != watch.landed.landed:
        return False
    if given.armed != 0.0:
        if landed.landed != 0.0:
            return False  # the timers that disarm it
        pose, was, lands = pose_of(measured), int(given.approach), given.lands != 0.0
        if given.scripted != 0.0:
            asked = carried(given.asked, (t_us - given.asked_us) * 1e-6)
            if landing.approach(was, asked, pose, landed.ground, given.limits) != was:
                return False
        if lands or given.scripted == 0.0:
            flown = carried(_unpack_setpoint(setpoint), age)
            touchdown = landing.touches(
                watch.touchdown, flown, pose, landed.ground, t_us, lands, given.anywhere_us
            )
            if touchdown.done != watch.touchdown.done:
                return False
    look_us = t_us + LOOK_US
    _pack_landed(watch_buffer, landed)
    _pack_touchdown(watch_buffer, touchdown)
    _pack_look(watch_buffer, look_us)
    _pack_wake(watch_buffer, minimum(look_us, minimum(given.until_us, given.deadline_us)))
    return True


def warm_up(limits: PlanLimits) -> None:
    """Compile what looks call one by one; what flies in bursts compiles `quiet_look` in itself."""
    measured, asked = np.zeros(size(VehicleState)), at(STILL, 0.0)
    pose = pose_at(measured)
    LandedDetector(Rotors(*[1.0] * 8), 1.0).see(measured, 0)
    TouchdownDetector().see(asked, pose, 0.0, 0)
    landing.approach_at(0, to_buffer(asked), 0.0, measured, 0.0, to_buffer(limits))
    landing.raised(asked, pose, 0.0)
    landing.landing_from(asked, pose, 0.0)
    stop(STILL, STILL, limits)
    carried(asked, 0.0)
