"""Where the vehicle is and what it flies: the last state, the setpoint, and what leads it.

Who may change that, and when, is the supervisor's business. Frames: Earth ENU; SI; times are
simulation time in whole microseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.kernel.rotations import euler, matrix
from fcu.laws.mmrac.reference_model import carried
from fcu.mavlink.enums import Result
from fcu.parameters import Parameters
from fcu.vehicle import guidance, touchdown
from fcu.vehicle.foresight import Foresight
from fcu.vehicle.landed import Landed
from fcu.vehicle.plans import SLOW_BELOW, Leader, limits
from fcu.vehicle.script import Limits, Pose, Script, anchored
from fcu.vehicle.touchdown import Touchdown, Way
from fcu.vehicle.verdict import Verdict, denied

Row = np.ndarray[Any, np.dtype[np.float64]]

NEAR = 2.0  # m: an old setpoint farther from the vehicle than this is not gone on from


class Pilot:
    """What is flown, of one vehicle."""

    def __init__(self, params: Parameters, sim_only: bool) -> None:
        """`sim_only`: a script's stream is lost by simulation time alone."""
        self._params = params
        self.leader = Leader()
        self.script = Script(sim_only)
        self._landed = Landed(params.law.c_T, params.law.m_hat_0 * params.law.g)
        self._way = Way.AS_ASKED  # how the script's setpoint is flown
        self._touchdown = Touchdown()
        self.cruise: float | None = None  # m/s, as told; None: MPC_XY_CRUISE
        self.state: Row | None = None  # the last measured VehicleState, as its buffer
        self.law_state: Row | None = None  # LawState after the last tick, as its buffer
        self.foresight = Foresight(params)

    @property
    def measured(self) -> VehicleState | None:
        """The last measured state; None before the plant was heard."""
        return None if self.state is None else from_buffer(VehicleState, self.state)

    @property
    def setpoint(self) -> Setpoint | None:
        """What is flown, as of `since_us`; None while disarmed."""
        return self.leader.setpoint

    @property
    def since_us(self) -> int:
        """When it took effect."""
        return self.leader.since_us

    def pose(self) -> Pose:
        """Where the vehicle is."""
        m = self.measured
        assert m is not None
        return Pose(m.r_E, m.v_E, euler(matrix(m.q_EB)).z)

    @property
    def reference(self) -> Row:
        """float64[6]: r_m and v_m of the reference model; the vehicle's own without a law."""
        if self.law_state is not None:
            return self.law_state[:6]
        here = self.pose()
        return np.concatenate([to_buffer(here.r_E), to_buffer(here.v_E)])

    def flown(self, t_us: int, pose: Pose | None = None) -> Setpoint:
        """The setpoint flown now, to go on from: the vehicle itself if that is elsewhere.

        `pose`: where it is, if that is known already.
        """
        here = self.pose() if pose is None else pose
        return anchored(self.setpoint, (t_us - self.since_us) * 1e-6, here, NEAR)

    def script_limits(self) -> Limits:
        """Above which a script's setpoint is flown at the limit."""
        p = self._params
        return Limits(
            p["MR_SP_DIST"], p["MR_SP_BELOW"], p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"],
            p.law.yaw_rate_max,
        )  # fmt: skip

    def change_speed(self, speed: float) -> Verdict:
        """Cruise speed (m/s) of what is laid down from now on; -1: MPC_XY_CRUISE again."""
        greatest = self._params["MPC_XY_VEL_MAX"]
        if speed != -1.0 and not 0.1 <= speed <= greatest:
            return denied("Speed", f"{speed:g} m/s (expected 0.1 to {greatest:g})")
        self.cruise = None if speed == -1.0 else speed
        return Verdict(Result.ACCEPTED)

    def _from(self, t_us: int) -> Pose:
        """Where a plan begins: the setpoint flown now, so that the law's input does not jump."""
        now = self.flown(t_us)
        return Pose(now.r_c, now.v_c, now.psi_c)

    def _limits(self) -> guidance.Limits:
        return limits(self._params, self.cruise)

    # --- near the ground

    @property
    def lands_for_script(self) -> bool:
        """Whether it lands because the script's setpoint leads into the ground."""
        return self._way is Way.DOWN

    def begin_anew(self) -> None:
        """Another mode: what was begun near the ground is over."""
        self._way, self._touchdown = Way.AS_ASKED, Touchdown()

    def steer(self, t_us: int) -> bool:
        """Fly the script's setpoint, or land if it leads into the ground; whether that begins."""
        asked, since_us, was = self.script.setpoint, self.script.since_us, self._way
        if asked is None:
            return False
        here, ground = self.pose(), self._landed.ground
        now: Setpoint = carried(asked, (t_us - since_us) * 1e-6)
        self._way = touchdown.way(was, now, here, ground, self._limits())
        if self._way is not Way.DOWN:
            raised = self._way is Way.RAISED
            self.leader.take(touchdown.raised(asked, here, ground) if raised else asked, since_us)
            if was is Way.DOWN:
                self._touchdown = Touchdown()
        elif was is not Way.DOWN:
            self._land_from(touchdown.landing_from(now, here, ground), t_us)
            return True
        return False

    @property
    def rests(self) -> bool:
        """Whether what led it down has met the ground."""
        return self._touchdown.done

    def touch_down(self, t_us: int, meant: bool) -> bool:
        """Rest on the ground once what leads it down has met it, `meant` so or not; whether it has."""
        assert self.setpoint is not None
        here = self.pose()
        flown: Setpoint = carried(self.setpoint, (t_us - self.since_us) * 1e-6)
        if not self._touchdown.see(
            flown, here, self._landed.ground, t_us, meant, self._params.law.f_m
        ):
            return False
        if self._touchdown.done:
            self.leader.take(touchdown.resting(flown, self._landed.light), t_us)
            return True
        self._land_from(here._replace(psi=flown.psi_c), t_us)
        return False

    def _land_from(self, here: Pose, t_us: int) -> None:
        r, v, psi = here
        slow_below = self._landed.ground + SLOW_BELOW  # not a number: slow from here
        speed = self._params["MPC_LAND_SPEED"]
        self.leader.follow(guidance.descent(r, v, psi, slow_below, speed, self._limits()), t_us)
        self.leader.advance(t_us)
