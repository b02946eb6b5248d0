"""Who may ask a vehicle for what, when: arming, modes, places to go.

Pure: requests and times in, a verdict in words out. It knows no socket, no clock and no
message; the loop asks it at every tick what to fly. What happens without being asked for is
`conduct`, which mode may follow which is `modes`. Times are simulation time in whole
microseconds, unless they are called wall.
"""

from __future__ import annotations

import math

from fcu.guard.admission import is_same_way
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import matrix
from fcu.mavlink.enums import Result
from fcu.vehicle import guidance, modes
from fcu.vehicle.conduct import Conduct
from fcu.vehicle.foresight import beside
from fcu.vehicle.guidance import STILL, Piece
from fcu.vehicle.modes import Mode, Need
from fcu.vehicle.plans import asks_too_much, settle_s, take_off
from fcu.vehicle.verdict import Verdict, denied

TILT_TO_ARM = math.radians(25.0)


class Supervisor(Conduct):
    """What one vehicle is asked for: granted, or denied with the reason."""

    def arm(self, t_us: int, wall_s: float) -> Verdict:
        """Start the rotors; the vehicle holds, or flies the mode it is in."""
        if self.armed:
            return Verdict(Result.ACCEPTED)
        why = self.why_not_arm(t_us, wall_s)
        if why:
            return denied("Arming", why)
        self.armed, self._armed_us, self.failsafe = True, t_us, ""
        self._landed.has_flown = not self._landed.landed
        if self._landed.landed:
            self._set_home(self.pose().r_E)
        self._enter(self.mode, t_us)
        return Verdict(Result.ACCEPTED, "Armed")

    def why_not_arm(self, t_us: int, wall_s: float) -> str:
        """The first reason against arming; empty if there is none."""
        why = self.unfit
        if not why and self.mode is Mode.OFFBOARD:
            ready = self.script.ready(t_us, wall_s, self.lost_us)
            why = "" if ready else Need.SETPOINTS.value
        return why

    @property
    def unfit(self) -> str:
        """Why the vehicle itself must not be armed; empty if it may."""
        m = self.measured
        if m is None:
            return Need.STATE.value
        if self.terminated:
            return "flight was terminated (restart gcs up)"
        if matrix(m.q_EB).e3.z < math.cos(TILT_TO_ARM):
            return f"tilted by more than {math.degrees(TILT_TO_ARM):.0f} degrees"
        if self.battery is not None and self.battery.remaining < self._params["BAT_CRIT_THR"]:
            return f"battery at {100.0 * self.battery.remaining:.0f} %"
        return ""

    def disarm(self, t_us: int, forced: bool = False) -> Verdict:
        """Stop the rotors: on the ground, or whatever happens if forced."""
        if self.armed and not self._landed.landed and not forced:
            return denied("Disarming", "in flight (land first)")
        was = self.armed
        self._disarm(t_us)
        return Verdict(Result.ACCEPTED, "Disarmed" if was else "")

    def terminate(self, t_us: int) -> Verdict:
        """Stop the rotors for good."""
        self.terminated = True
        self._disarm(t_us)
        return Verdict(Result.ACCEPTED, "Flight terminated")

    def select(self, wanted: Mode, t_us: int, wall_s: float) -> Verdict:
        """Another mode. TEMPORARILY_REJECTED while a script's stream is all that is missing."""
        if wanted is self.mode and wanted is not Mode.HOLD:
            return Verdict(Result.ACCEPTED)  # a script that repeats itself
        need = modes.denied(wanted, self._met(t_us, wall_s))
        if need is not None:
            rejected = Result.TEMPORARILY_REJECTED if need is Need.SETPOINTS else Result.DENIED
            refused = need is Need.SETPOINTS and self.foresight.refused
            why = "the guard refuses its setpoints" if refused else need.value
            return Verdict(rejected, f"{wanted.value} denied: {why}")
        too_much = asks_too_much(wanted, self._params)
        if too_much:
            return denied(wanted.value, too_much)
        lack = None
        if wanted is Mode.STEP:
            away = Vec3(*(self._params[f"REF_STEP_{axis}"] for axis in "ENU"))
            lack = self.foresight.of_step(self._from(t_us), away, self._limits(), self.reference)
        if lack is not None and self.foresight.refuses:
            return denied(wanted.value, str(lack))
        self.failsafe = ""
        self._enter(wanted, t_us)
        return Verdict(Result.ACCEPTED, f"Mode {wanted.value}{beside(lack)}")

    def take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Verdict:
        """Climb to the height `to_z` (m, E), or by MIS_TAKEOFF_ALT; then hold."""
        need = modes.denied(Mode.TAKEOFF, self._met(t_us, wall_s))
        if need is not None:
            return denied("Takeoff", need.value)
        here = self._from(t_us)
        height = self._params["MIS_TAKEOFF_ALT"] if to_z is None else to_z - here.r_E.z
        if not 0.0 < height <= 1000.0:
            return denied("Takeoff", f"{height:.1f} m up (expected above 0, at most 1000)")
        self.failsafe = ""
        self._become(Mode.TAKEOFF)
        plan = take_off(here, height, self._limits(), settle_s(self._params))
        self._follow(plan, t_us, ends=True)
        return Verdict(Result.ACCEPTED, f"Taking off to {height:.1f} m above here")

    def reposition(
        self, to: Vec3, psi: float | None, t_us: int, speed: float | None = None
    ) -> Verdict:
        """Hold somewhere else: straight there, within the limits; `speed`: as `change_speed`."""
        if not self.armed or self.state is None:
            return denied("Reposition", Need.ARMED.value)
        if self._landed.landed:
            return denied("Reposition", Need.AIRBORNE.value)
        was = self.cruise
        if speed is not None:
            told = self.change_speed(speed)
            if not told.good:
                return told
        here, led = self._from(t_us), self._limits()
        psi = here.psi if psi is None else psi
        lack = self.foresight.of_move(here, to, led, self.reference)
        if lack is not None and self.foresight.refuses:
            self.cruise = was
            return denied("Reposition", str(lack))
        self.failsafe = ""
        self._become(Mode.HOLD)
        self.begin_anew()
        self._follow(guidance.through(here.r_E, here.v_E, [to], psi, led), t_us)
        far = guidance.length(to - here.r_E)
        return Verdict(Result.ACCEPTED, f"Going {far:.0f} m{beside(lack)}")

    def move(self, v: Vec3, psi_dot: float, t_us: int) -> None:
        """Sticks in position mode: a velocity (m/s, E) and a yaw rate (rad/s)."""
        if not self.armed or self.mode is not Mode.POSITION:
            return
        if self.rests:
            if v.z <= 0.0:
                return  # it is on the ground, and stays there
            self.begin_anew()
        now = self.flown(t_us)
        piece = Piece(
            Setpoint(now.r_c, v, STILL, now.psi_c, psi_dot), self._params["COM_RC_LOSS_T"]
        )
        r, psi = now.r_c + piece.for_s * v, now.psi_c + piece.for_s * psi_dot
        stop = Piece(Setpoint(r, STILL, STILL, psi, 0.0), math.inf)
        self._follow([piece, stop], t_us)

    def set_home(self, home: Vec3 | None) -> Verdict:
        """Where a return flies to; None: here."""
        if self.state is None:
            return denied("Home", Need.STATE.value)
        self._set_home(self.pose().r_E if home is None else home)
        return Verdict(Result.ACCEPTED, "Home set")

    def keep_script(self, t_us: int, wall_s: float) -> str:
        """The script has a setpoint that is not flown: what it flies by goes on. What is to be said."""
        if not self.armed or self.mode is not Mode.OFFBOARD:
            return ""
        self.script.keep(t_us, wall_s)
        return self.fly_script(t_us)

    def is_flown(self, setpoint: Setpoint) -> bool:
        """Whether it is the script's that is flown already, but for its yaw."""
        asked = self.script.setpoint
        if not self.armed or self.mode is not Mode.OFFBOARD or asked is None:
            return False
        return is_same_way(setpoint, asked)

    def _met(self, t_us: int, wall_s: float) -> frozenset[Need]:
        landed = self._landed.landed
        met = {
            Need.STATE: self.state is not None,
            Need.ARMED: self.armed,
            Need.AIRBORNE: not landed,
            Need.GROUNDED: landed,
            Need.SETPOINTS: self.script.ready(t_us, wall_s, self.lost_us),
        }
        return frozenset(need for need, yes in met.items() if yes)
