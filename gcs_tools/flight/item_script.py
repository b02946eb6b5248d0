"""The items of a mission, flown one after the other as a ground script would have them flown.

Simulation time stands while the script says something, and runs to its next look: ten a second. It
sees where the vehicle is by the truth, as the verdict does, and whether it flies by what the controller
tells. Over the wire and in one process the looks fall on the same ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, Protocol

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.mavlink.geodesy import Origin, to_geodetic
from gcs_tools.flight.ground_script import SLOW_M_S, Refused
from gcs_tools.flight.scenario import Scenario
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.items import Plan
from gcs_tools.missions.plan_file import PlanFile
from gcs_tools.missions.timeline import (
    LANDS,
    PLANS,
    Begun,
    Leg,
    PlanProgress,
    at_rest,
    on_path,
    path_ticks,
)

LOOK_S = 0.1  # simulation time between two looks
ASK_S = 0.5  # simulation time between two questions how far a plan is flown
SEND_AGAIN_S = 0.9  # simulation time after which a setpoint is sent again, if there is no other


class Flyer(Protocol):
    """What a script tells: a Vehicle, or a controller that is sent setpoints and nothing else."""

    def wait_ready(self) -> None:
        """Until it could fly. Raises VehicleError; the others too."""

    def set_setpoint(self, setpoint: Setpoint, time_s: float = 0.0, /) -> None:
        """Have it flown, from then on."""

    def offboard(self) -> None:
        """Fly the setpoints sent."""

    def arm(self) -> None:
        """Arm."""

    def take_off(self, height_m: float) -> None:
        """Climb by so much from here."""

    def land(self) -> None:
        """Land here."""

    def return_home(self) -> None:
        """Fly home and land there."""

    def fly_plan(self, plan: PlanFile, origin: Origin) -> None:
        """Upload a plan whose places are about `origin`, the place of local (0, 0, 0), and fly it."""

    def plan_progress(self) -> PlanProgress:
        """How far the plan is flown."""


class Seen(NamedTuple):
    """What a look sees of the last tick that was flown."""

    r_E: Vec3  # m, true
    v_E: Vec3  # m/s, true
    flies: bool  # the controller is armed, and flies the law
    stands: bool  # on the ground, truly


class ItemScript:
    """Has one vehicle do the items of a mission.

    After `fly`: `begun`, the legs that were begun; `is_done`, whether all are; `refusal`, in words,
    what the vehicle would not do (empty: nothing).
    """

    def __init__(
        self, scene: Scenario, vehicle: Flyer, fly_to: Callable[[int], bool],
        look: Callable[[int], Seen],
    ) -> None:  # fmt: skip
        """`fly_to`: lets time run to a tick; False if the flight has ended. `look`: at the last tick."""
        self._scene, self._vehicle = scene, vehicle
        self._fly_to, self._look = fly_to, look
        self._tick = 0
        self._setpoint: Setpoint | None = None  # that is streamed; None: the vehicle leads itself
        self._sent_at = 0
        self._asked_at = 0  # how far its plan is
        self.begun: list[Begun] = []
        self.is_done = False
        self.refusal = ""

    def begin(self) -> None:
        """Ready; one that starts in the air is armed, and holds where it is. Raises VehicleError."""
        self._vehicle.wait_ready()
        if not self._scene.flight.start.on_ground:
            self._stream(at_rest(self._scene.begin.r_E, self._scene.sent[0].psi_c))
            self._vehicle.arm()

    def fly(self) -> None:
        """All of them, or until the flight ends or its time is over. Raises VehicleError."""
        for number, leg in enumerate(self._scene.legs):
            try:
                self._begin(number, leg)
                if not self._do(leg):
                    return
            except Refused as error:
                self.refusal = str(error)
                return
        self.is_done = True

    def _begin(self, number: int, leg: Leg) -> None:
        place = leg.place
        if leg.kind == "take_off":
            here = self._seen().r_E
            to_z = self._scene.flight.ground_z_m + leg.height
            place = Vec3(*(round(x, 3) for x in (here.x, here.y, to_z)))
        elif leg.kind == "hold" and place is None and self.begun:
            place = self.begun[-1].place  # of the take-off before
        self.begun.append(Begun(number, self._tick, place))
        if leg.kind == "take_off":
            self._setpoint = None
            self._vehicle.arm()
            assert place is not None
            self._vehicle.take_off(place.z - self._seen().r_E.z)
        elif leg.kind == "land":
            self._setpoint = None
            self._vehicle.land()
        elif leg.kind == "return":
            self._setpoint = None
            self._vehicle.return_home()
        elif leg.kind in PLANS:
            self._setpoint = None
            item = self._scene.flight.items[leg.item]
            assert isinstance(item, Plan)
            self._vehicle.fly_plan(item.plan, origin_of(item.plan, self._scene.flight))
            self._asked_at = self._tick
        elif leg.path is not None:
            self._stream(on_path(leg, 0.0))
        elif leg.kind == "go_to":
            assert place is not None
            self._stream(at_rest(place, leg.psi))

    def _do(self, leg: Leg) -> bool:
        """Until a leg is done; False: the flight has ended before."""
        begin = self.begun[-1]
        rate = self._scene.rate_hz
        moves = (
            iter(()) if leg.path is None else iter(path_ticks(leg, begin.tick, self._scene.flight))
        )
        rests_from = begin.tick
        if leg.path is not None:
            rests_from += math.ceil(leg.path.duration_s * rate)
        ends = begin.tick + round(leg.for_s * rate)
        for tick in _looks(begin.tick, moves, ends if leg.for_s else None, round(LOOK_S * rate)):
            if tick > begin.tick:
                last = min(tick, self._scene.ticks)
                if not self._fly_to(last):
                    return False
                self._tick = last
            if leg.path is not None and begin.tick < self._tick <= rests_from:
                self._stream(on_path(leg, (self._tick - begin.tick) / rate))  # at its end, at rest
            if self._is_done(leg, begin, rests_from, ends):
                return True
            if self._tick >= self._scene.ticks:
                return False
            if self._setpoint is not None and self._tick - self._sent_at >= SEND_AGAIN_S * rate:
                self._stream(self._setpoint)
        raise AssertionError("looks have no end")

    def _is_done(self, leg: Leg, begin: Begun, rests_from: int, ends: int) -> bool:
        if leg.kind == "hold":
            return self._tick >= ends
        if self._tick < rests_from or self._tick == begin.tick == 0:
            return False
        seen = self._seen()
        if leg.kind in LANDS:
            return seen.stands and not seen.flies
        if leg.kind in PLANS:
            if self._tick - self._asked_at < ASK_S * self._scene.rate_hz:
                return False
            self._asked_at = self._tick
            progress = self._vehicle.plan_progress()
            self.begun[-1] = begin._replace(plan=progress)
            return progress.is_complete
        assert begin.place is not None
        near = math.dist(seen.r_E, begin.place) <= leg.within
        aloft = seen.flies and not seen.stands
        return near and aloft and math.hypot(*seen.v_E) <= SLOW_M_S

    def _seen(self) -> Seen:
        if self._tick == 0:
            start = self._scene.world.start
            return Seen(start.r_E, start.v_E, False, self._scene.flight.start.on_ground)
        return self._look(self._tick)

    def _stream(self, setpoint: Setpoint) -> None:
        """Send it, and have it flown."""
        begins = self._setpoint is None
        for _ in range(1 + begins):  # one setpoint is not a stream yet
            self._vehicle.set_setpoint(setpoint, self._tick / self._scene.rate_hz)
        if begins:
            self._vehicle.offboard()
        self._setpoint, self._sent_at = setpoint, self._tick


SEA_M = 488.0  # of a plan that does not say how high its home is: of the origin, as PX4's SITL


def origin_of(plan: PlanFile, flight: Flight) -> Origin:
    """The place on Earth that local (0, 0, 0) has to be, so that the flight begins at the plan's home."""
    home, start = plan.begin, flight.start.position_m
    alt_m = SEA_M if home.alt_m is None else home.alt_m
    about = Origin(home.lat_deg, home.lon_deg, alt_m)
    place = to_geodetic(about, Vec3(-start[0], -start[1], -flight.ground_z_m))
    return Origin(place.lat_deg, place.lon_deg, place.alt_m)


def _looks(begin: int, moves: Iterable[int], ends: int | None, every: int) -> Iterator[int]:
    """The ticks of a leg at which something is sent or looked at: begin, those of a path, its end, and
    then one in so many.
    """  # fmt: skip
    yield begin
    last = begin
    for last in moves:
        if last > begin:
            yield last
    while True:
        last += every
        if ends is not None and last - every < ends < last:
            yield ends
        yield last
