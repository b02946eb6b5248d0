"""Commands of ground stations and scripts: what each takes, and what is done about it.

Every command is answered, to its sender. What is wrong with one is said in words, and changes
nothing. The table says which parameters mean something; another that is not 0 or NaN is an
error, since its sender expects something that will not happen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from fcu.kernel.algebra import Vec3
from fcu.mavlink.enums import GLOBAL_FRAMES, RELATIVE_FRAMES, CommandId, Result
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.ground_messages import Command
from fcu.mavlink.kinds import command_name
from fcu.vehicle import modes
from fcu.vehicle.modes import Mode
from fcu.vehicle.supervisor import Supervisor
from fcu.vehicle.verdict import Verdict

FORCE = 21196.0  # COMPONENT_ARM_DISARM, parameter 2: do it whatever the checks say
CUSTOM_MODE = 1  # MAV_MODE_FLAG
FARTHEST, LOWEST = 20_000.0, 100.0  # m from here, and below home: nobody flies there
TAKEOFF_ASIDE = 10.0  # m: a take-off that names a place farther away is not a take-off


class Request(NamedTuple):
    """One command at its moment."""

    command: Command
    t_us: int  # simulation time at which it takes effect
    wall_s: float

    def parameter(self, n: int) -> float:
        """Parameter n, from 1; NaN where it is left to the vehicle."""
        return self.command.params[n - 1]

    def given(self, n: int, default: float) -> float:
        """Parameter n, or the default if it is NaN."""
        value = self.parameter(n)
        return default if math.isnan(value) else value


class Spec(NamedTuple):
    """One command: what runs it, and what its parameters may be."""

    run: Callable[[Request], Verdict]
    used: tuple[int, ...] = ()  # parameters that mean something; NaN: default
    required: tuple[int, ...] = ()  # of these, those that must be numbers
    to_all: bool = True  # also when it is sent to every system
    place: bool = False  # parameters 5 to 7 are a place on Earth: exact in COMMAND_INT only
    what: str = ""


def _denied(text: str) -> Verdict:
    return Verdict(Result.DENIED, text)


class Commands:
    """The flight commands of one vehicle; the ground services add theirs to `table`."""

    def __init__(self, vehicle: Supervisor, origin: Origin) -> None:
        self._vehicle = vehicle
        self._origin = origin
        arm = Spec(self._arm, (1, 2), (1,), to_all=False, what="Arming")
        self.table: dict[int, Spec] = {
            CommandId.ARM_DISARM: arm,
            CommandId.SET_MODE: Spec(self._set_mode, (1, 2, 3), (1, 2), what="Mode"),
            CommandId.SET_STANDARD_MODE: Spec(self._standard_mode, (1,), (1,), what="Mode"),
            CommandId.TAKEOFF: Spec(self._take_off, (1, 4, 5, 6, 7), what="Takeoff"),
            CommandId.LAND: Spec(self._land, (1, 2, 4, 5, 6, 7), what="Landing"),
            CommandId.RETURN: Spec(self._return, what="Return"),
            CommandId.REPOSITION: Spec(
                self._reposition, (1, 2, 3, 4, 5, 6, 7), place=True, what="Reposition"
            ),
            CommandId.PAUSE_CONTINUE: Spec(self._pause, (1,), (1,), what="Pause"),
            CommandId.CHANGE_SPEED: Spec(self._speed, (1, 2, 3), (2,), what="Speed"),
            CommandId.SET_HOME: Spec(self._set_home, (1, 5, 6, 7), (1,), what="Home"),
            CommandId.FLIGHT_TERMINATION: Spec(
                self._terminate, (1,), (1,), to_all=False, what="Termination"
            ),
            CommandId.RUN_PREARM_CHECKS: Spec(self._checks, what="Checks"),
        }

    def answer(self, request: Request) -> Verdict:
        """Check a command against the table, and run it."""
        command = request.command
        spec = self.table.get(command.command)
        if spec is None:
            return Verdict(Result.UNSUPPORTED, f"{command_name(command.command)} is not supported")
        if command.target_system == 0 and not spec.to_all:
            return _denied(f"{spec.what} denied: it must name this system")
        if command.frame is None and spec.place:
            return Verdict(Result.COMMAND_INT_ONLY, f"{spec.what} denied: send it as COMMAND_INT")
        if command.frame is not None and spec.place and command.frame not in GLOBAL_FRAMES:
            return Verdict(
                Result.UNSUPPORTED_MAV_FRAME, f"{spec.what} denied: frame {command.frame}"
            )
        for n, value in enumerate(command.params, start=1):
            if math.isinf(value) or (n in spec.required and math.isnan(value)):
                return _denied(f"{spec.what} denied: parameter {n} is not a number")
            if n not in spec.used and not math.isnan(value) and value != 0.0:
                return _denied(f"{spec.what} denied: parameter {n} means nothing here (0 or NaN)")
        return spec.run(request)

    # --- each

    def _arm(self, request: Request) -> Verdict:
        want, forced = request.parameter(1), request.given(2, 0.0) == FORCE
        if want not in (0.0, 1.0):
            return _denied("Arming denied: parameter 1 is neither 0 nor 1")
        if want == 0.0:
            return self._vehicle.disarm(request.t_us, forced)
        return self._vehicle.arm(request.t_us, request.wall_s)

    def _set_mode(self, request: Request) -> Verdict:
        base, main, sub = request.parameter(1), request.parameter(2), request.given(3, 0.0)
        if not int(base) & CUSTOM_MODE:
            return _denied("Mode denied: only custom modes are known (base mode 1)")
        numbers = int(main), int(sub)
        return self.select(modes.of_numbers(*numbers), request, modes.shown(*numbers))

    def _standard_mode(self, request: Request) -> Verdict:
        number = int(request.parameter(1))
        name = modes.OTHER_STANDARD.get(number, f"{number} (standard)")
        return self.select(modes.of_standard(number), request, name)

    def select(self, mode: Mode | None, request: Request, asked: str) -> Verdict:
        """Another mode; None: one that this vehicle does not have. `asked`: what it is called."""
        if mode is None:
            return _denied(f"Mode {asked} denied: this vehicle has none such")
        return self._vehicle.select(mode, request.t_us, request.wall_s)

    def _place(self, request: Request) -> Vec3 | None:
        """Parameters 5 to 7 as a position; what is left out is where the vehicle is."""
        vehicle = self._vehicle
        here = vehicle.pose().r_E
        lat, lon, alt = (request.parameter(n) for n in (5, 6, 7))
        if abs(lat) > 90.0 or abs(lon) > 180.0 or math.isnan(lat) != math.isnan(lon):
            return None
        r = here
        if not (math.isnan(lat) or math.isnan(lon)):
            r = to_local(self._origin, lat, lon, self._origin.alt_m)
            if not math.dist(r[:2], here[:2]) <= FARTHEST:  # 0, 0: mostly one that was left out
                return None
        if math.isnan(alt):
            return Vec3(r.x, r.y, here.z)
        z = alt - self._origin.alt_m
        if request.command.frame in RELATIVE_FRAMES and vehicle.home is not None:
            z = alt + vehicle.home.z
        ground = here.z if vehicle.home is None else vehicle.home.z
        if not ground - LOWEST <= z <= ground + FARTHEST:  # as above: a height of 0
            return None
        return Vec3(r.x, r.y, z)

    def _take_off(self, request: Request) -> Verdict:
        vehicle = self._vehicle
        if vehicle.state is None or vehicle.home is None:
            return _denied("Takeoff denied: no state from the plant yet")
        lat, lon, alt = (request.parameter(n) for n in (5, 6, 7))
        named = not (math.isnan(lat) or math.isnan(lon) or lat == lon == 0.0)
        place = self._place(request) if named else None
        here = vehicle.pose().r_E
        if named and (place is None or math.dist(place[:2], here[:2]) > TAKEOFF_ASIDE):
            return _denied("Takeoff denied: the place is not here")
        if math.isnan(alt) or (alt == 0.0 and not named):
            return vehicle.take_off(None, request.t_us, request.wall_s)
        z = alt - self._origin.alt_m
        # Above the sea, as PX4 reads it; what would be below ground is a height above home.
        above_home = request.command.frame in RELATIVE_FRAMES or z <= vehicle.home.z
        z = alt + vehicle.home.z if above_home else z
        if not abs(alt) <= 1e5:
            return _denied("Takeoff denied: the height is not possible")
        return vehicle.take_off(z, request.t_us, request.wall_s)

    def _land(self, request: Request) -> Verdict:
        lat, lon = request.parameter(5), request.parameter(6)
        if not (math.isnan(lat) or math.isnan(lon) or lat == lon == 0.0):
            place, here = self._place(request), self._vehicle.state
            if here is None or place is None:
                return _denied("Landing denied: no place within 20 km of here")
            if math.dist(place[:2], self._vehicle.pose().r_E[:2]) > TAKEOFF_ASIDE:
                return _denied("Landing denied: it lands where it is (reposition first)")
        return self._vehicle.select(Mode.LAND, request.t_us, request.wall_s)

    def _return(self, request: Request) -> Verdict:
        return self._vehicle.select(Mode.RETURN, request.t_us, request.wall_s)

    def _reposition(self, request: Request) -> Verdict:
        vehicle = self._vehicle
        speed = request.given(1, -1.0)  # m/s; -1: as it is
        if vehicle.state is None or vehicle.home is None:
            return _denied("Reposition denied: no state from the plant yet")
        to = self._place(request)
        if to is None:
            return _denied("Reposition denied: no place within 20 km of here")
        yaw = request.parameter(4)
        psi = None if math.isnan(yaw) else 0.5 * math.pi - yaw
        return vehicle.reposition(to, psi, request.t_us, None if speed == -1.0 else speed)

    def _pause(self, request: Request) -> Verdict:
        if request.parameter(1) not in (0.0, 1.0):
            return _denied("Pause denied: parameter 1 is neither 0 nor 1")
        if request.parameter(1) == 1.0:
            return _denied("Continuing denied: there is no mission")
        return self._vehicle.select(Mode.HOLD, request.t_us, request.wall_s)

    def _speed(self, request: Request) -> Verdict:
        if request.given(1, 1.0) not in (0.0, 1.0):
            return _denied("Speed denied: only ground speed can be set")
        return self._vehicle.change_speed(request.parameter(2))

    def _set_home(self, request: Request) -> Verdict:
        if request.parameter(1) == 1.0:
            return self._vehicle.set_home(None)
        if self._vehicle.state is None:
            return _denied("Home denied: no state from the plant yet")
        if any(math.isnan(request.parameter(n)) for n in (5, 6, 7)):
            return _denied("Home denied: it has no place")
        if request.command.frame is None:
            return Verdict(Result.COMMAND_INT_ONLY, "Home denied: send it as COMMAND_INT")
        if request.command.frame not in GLOBAL_FRAMES:
            return Verdict(
                Result.UNSUPPORTED_MAV_FRAME, f"Home denied: frame {request.command.frame}"
            )
        place = self._place(request)
        if place is None:
            return _denied("Home denied: no place within 20 km of here")
        return self._vehicle.set_home(place)

    def _terminate(self, request: Request) -> Verdict:
        if request.parameter(1) <= 0.5:
            return Verdict(Result.ACCEPTED)
        return self._vehicle.terminate(request.t_us)

    def _checks(self, request: Request) -> Verdict:
        why = self._vehicle.why_not_arm(request.t_us, request.wall_s)
        return Verdict(Result.ACCEPTED, f"Not ready to arm: {why}" if why else "Ready to arm")
