"""Flies the steps of a plan: legs with rounded corners, as pieces of constant acceleration.

A corner is rounded within the acceptance radius of its place, so that the speed is kept. Its curve
begins and ends `d` from the place and is one piece of constant acceleration: it passes the place
at d |u2 - u1| / 4, with u1 and u2 the directions of the legs. The time of a plan waits for the
vehicle: where the reference or the vehicle lags behind, as in a wind that the guard slows it for,
pieces are flown more slowly. Pure. Frames: Earth ENU, SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import wrap
from fcu.laws.setpoint import carried
from fcu.vehicle import landing, plans
from fcu.vehicle.mission import FLOWN, Do, Mission, Step, is_finite, leads, placed
from fcu.vehicle.plans import STILL, Piece, PlanLimits, Pose, at, length

CUT_S = 0.1  # the longest piece while the vehicle moves or turns
SHORT_S = 0.02  # a remainder shorter than this is flown with the piece before
SLOWS_FROM, STOPS_AT = 0.7, 2.0  # m that the vehicle lags: from here slower, here not at all
EASES = 0.1  # of the speed: by so much it changes from piece to piece
WITHIN = 0.7  # of the acceptance radius, in which a corner is rounded
SHARE = 0.45  # of a leg, that a corner takes at most
REMAINDER = 0.8  # the same, of a leg whose begin a corner has taken
CHORDS, MOST_CHORDS = 8, 1000  # of a curve, which are held against the fence
AT_A_TIME = 16  # steps that take no time, done from one tick to another where the vehicle rests
BULGE = 0.01  # m, that a curve may lie outside its chords
STRAIGHT = 1e-3  # |u2 - u1| of legs that are one line
TURNS = 0.5  # rad/s, at most
FACES_FROM = 1.0  # m across: a shorter leg does not turn the vehicle
TURNED = 1e-3  # rad
OVER = 0.5  # m across from its place, within which a landing begins
SLOW = 0.5  # m/s, of a vehicle that has arrived
CIRCLE_PART = 0.5  # of the acceleration there is, that a circle asks for


class Sees(NamedTuple):
    """All that a plan's flight asks of the vehicle, and what it sets."""

    off: Callable[[Vec3], float]  # m, how far reference or vehicle are from a place
    pose: Callable[[], Pose]
    is_landed: Callable[[], bool]
    home: Callable[[], Vec3]
    ground: Callable[[], float]  # m, E, where it has stood; NaN: not known
    is_clear: Callable[[Vec3, Vec3], bool]  # a straight way, of the fence
    limits: Callable[[float | None], PlanLimits]  # of a cruise speed; None: the one in force
    set_cruise: Callable[[float], object]
    set_home: Callable[[Vec3 | None], object]
    light: Callable[[], float]  # N, of rotors on the ground
    takes_off: Callable[[], None]
    parameter: Callable[[str], float]
    yaw_rate: Callable[[], float]  # rad/s, at most


class Leg(NamedTuple):
    """A straight way, and how fast it is flown along it."""

    start: Vec3
    ahead: Vec3  # a unit vector
    far: float  # m
    speed: float  # m/s
    acceleration: float  # m/s^2


def leg_of(start: Vec3, end: Vec3, led: PlanLimits) -> Leg | None:
    """The leg between two places. None if they are one."""
    far = length(end - start)
    if far < 1e-6:
        return None
    ahead = (1.0 / far) * (end - start)
    speed, acceleration = plans.limits_along(ahead, led)
    return Leg(start, ahead, far, speed, acceleration)


class Corner(NamedTuple):
    """The way in which two legs join."""

    before: float  # m before the place at which the curve begins, and behind it where it ends
    speed: float  # m/s, at both ends
    for_s: float
    acceleration: Vec3


def corner_of(leg: Leg, onward: Leg, radius: float, room: float, led: PlanLimits) -> Corner | None:
    """The curve between two legs. None if the vehicle has to stop there.

    room : m of the first leg that the curve may take.  The speed lets the vehicle stop at the end of
    the second leg.
    """
    bends = onward.ahead - leg.ahead
    bend = length(bends)
    if bend < STRAIGHT:
        speed = min(leg.speed, onward.speed, math.sqrt(2.0 * onward.acceleration * onward.far))
        return Corner(0.0, speed, 0.0, STILL)
    before = min(WITHIN * 4.0 * radius / bend, room, SHARE * onward.far)
    if before <= 0.0:
        return None
    _, most = plans.limits_along((1.0 / bend) * bends, led)
    speed = min(
        leg.speed, onward.speed, math.sqrt(2.0 * most * before / bend),
        math.sqrt(2.0 * onward.acceleration * (onward.far - before)),
    )  # fmt: skip
    for_s = 2.0 * before / speed
    return Corner(before, speed, for_s, (speed / for_s) * bends)


def straight(leg: Leg, far: float, begins: float, ends: float) -> list[Piece]:
    """Along a leg for `far` (m), from a speed to another (m/s), each at most that of the leg."""
    if far < 1e-9:
        return []
    a = max(leg.acceleration, abs(begins * begins - ends * ends) / (2.0 * far))
    top = math.sqrt(0.5 * (2.0 * a * far + begins * begins + ends * ends))
    top = max(begins, ends, min(leg.speed, top))
    up, down = (top * top - begins * begins) / (2.0 * a), (top * top - ends * ends) / (2.0 * a)
    flat = max(far - up - down, 0.0)
    r, pieces = leg.start, []
    for v, accel, for_s in (
        (begins, a, (top - begins) / a), (top, 0.0, flat / top), (top, -a, (top - ends) / a)
    ):  # fmt: skip
        if for_s > 1e-9:
            pieces.append(Piece(at(r, 0.0, v * leg.ahead, accel * leg.ahead), for_s))
            r = r + (v * for_s + 0.5 * accel * for_s * for_s) * leg.ahead
    return pieces


class MissionFlight:
    """Lays down the pieces of a plan, one at a time, as the vehicle comes to them."""

    def __init__(
        self, mission: Mission, sees: Sees, begin: Pose, cut_s: float = CUT_S
    ) -> None:  # fmt: skip
        """`begin`: the setpoint that is flown now.  cut_s : s, of the longest piece while it moves."""
        self._mission, self._sees, self._begin = mission, sees, begin
        self._cut_s = cut_s
        self._r, self._psi = begin.r_E, begin.psi
        self._speed = 0.0  # m/s, along the leg that begins
        self._part = 1.0  # of the speed, at which pieces are flown
        self._heading: float | None = None  # rad; None: along the way
        self._look_at: Vec3 | None = None
        self._has_turned = False  # `_heading` is that of a turn
        self._ahead = begin.psi  # rad, heading of the way
        self._at_once = 0  # steps done since the last piece
        self._to: Step | None = None  # the next place, if a distance to it was asked for

    def pieces(self) -> Iterator[Piece]:
        """All of them. The last one has no end."""
        mission = self._mission
        mission.begun, mission.lands, mission.hands_over = True, False, False
        if self._sees.is_landed():
            self._r = self._sees.pose().r_E
        else:
            stopping, self._r = plans.brake(
                self._begin.r_E, self._begin.v_E, self._begin.psi, self._sees.limits(None)
            )
            yield from self._along(stopping)
        while mission.current < len(mission.steps):
            step = mission.steps[mission.current]
            if self._sees.is_landed():
                rises = self._next_place() if step.do is Do.NEAR else step
                if rises is not None and rises.do in FLOWN:
                    yield from self._climb(rises)
            yield from self._do(step)
            if self._at_once > len(mission.steps) + 1:  # a loop of steps that take no time
                yield from self._stay(CUT_S)
            elif self._at_once >= AT_A_TIME and self._speed == 0.0:
                # a tick has no time for 2000 of them
                yield self._still(self._r, CUT_S)
        mission.complete()
        mission.events.append(Told(Code.MISSION_COMPLETE))
        yield from self._stay(math.inf)

    def _do(self, step: Step) -> Iterator[Piece]:
        self._at_once += 1
        if leads(step):
            self._to = None
        if step.do in (Do.GO_TO, Do.LOITER, Do.TAKE_OFF):
            yield from self._go_to(step)
        elif step.do is Do.NEAR:
            yield from self._near(step)
        elif step.do is Do.LAND:
            yield from self._land(step)
        elif step.do is Do.CIRCLE:
            yield from self._circle(step)
        elif step.do is Do.WAIT:
            yield from self._stay(step.hold_s)
        elif step.do is Do.TURN:
            yield from self._turn(step)
        elif step.do is Do.RETURN:
            self._mission.done()
            if self._mission.current >= len(self._mission.steps):
                self._mission.complete()
            self._mission.hands_over = True
            yield plans.rest(self._r, self._psi)
            return
        elif step.do is Do.SPEED:
            self._sees.set_cruise(step.value)
        elif step.do is Do.HOME:
            place = placed(step, self._sees.home())
            self._sees.set_home(place)
        elif step.do in (Do.LOOK_AT, Do.LOOK_AHEAD):
            self._look_at = placed(step, self._sees.home())
            self._heading, self._has_turned = None, False
        if step.do is not Do.LOITER:
            self._mission.done()

    # --- pieces, as they are flown

    def _wanted(self, r: Vec3) -> float:
        """The heading that the vehicle is to have at a place, rad."""
        if self._look_at is not None:
            away = self._look_at - r
            over = math.hypot(away.x, away.y) < plans.AT_CENTER
            return self._psi if over else math.atan2(away.y, away.x)
        if self._heading is not None:
            return self._heading
        return self._ahead

    def _turning(self, r: Vec3, for_s: float) -> tuple[float, float]:
        """The heading (rad) and its rate (rad/s) of a piece that takes so long."""
        away = float(wrap(self._wanted(r) - self._psi))
        most = min(TURNS, self._sees.yaw_rate())
        rate = max(-most, min(most, away / for_s))
        psi = self._psi
        self._psi = float(wrap(psi + rate * for_s))
        return psi, rate

    def _along(self, pieces: Iterable[Piece]) -> Iterator[Piece]:
        """Pieces at the speed at which the vehicle follows, with their heading."""
        for piece in pieces:
            at_s, left = 0.0, piece.for_s
            while left > 1e-9:
                now: Setpoint = carried(piece.setpoint, at_s)
                part = self._follows(now.r_c)
                if part <= 0.0:
                    yield self._still(now.r_c, CUT_S)
                    continue
                step = min(left, part * self._cut_s)
                if left - step < part * SHORT_S:
                    step = left
                psi, rate = self._turning(now.r_c, step / part)
                self._at_once = 0
                yield Piece(
                    now._replace(
                        v_c=part * now.v_c, a_c=(part * part) * now.a_c, psi_c=psi, psi_dot_c=rate
                    ),
                    step / part,
                )
                at_s, left = at_s + step, left - step

    def _follows(self, r: Vec3) -> float:
        """The part of its speed at which the next piece is flown."""
        wanted = (STOPS_AT - self._sees.off(r)) / (STOPS_AT - SLOWS_FROM)
        wanted = max(0.0, min(1.0, wanted))
        self._part = max(self._part - EASES, min(self._part + EASES, wanted))
        if self._part < 0.5 * EASES:
            self._part = 0.0
        return self._part

    def _still(self, r: Vec3, for_s: float) -> Piece:
        """Rest at a place, turning. On the ground with light rotors."""
        self._at_once = 0
        if self._sees.is_landed():
            return Piece(landing.resting(at(r, self._psi), self._sees.light()), for_s)
        psi, rate = self._turning(r, for_s) if math.isfinite(for_s) else (self._psi, 0.0)
        return Piece(at(r, psi)._replace(psi_dot_c=rate), for_s)

    def _is_turned(self) -> bool:
        return abs(float(wrap(self._wanted(self._r) - self._psi))) < TURNED

    def _stay(self, for_s: float) -> Iterator[Piece]:
        """Rest where it is, turn to the heading wanted, and then stay for a time."""
        while not self._sees.is_landed() and not self._is_turned():
            yield self._still(self._r, CUT_S)
        if for_s > 0.0:
            yield self._still(self._r, for_s)

    def _arrive(self, radius: float, across: bool = False) -> Iterator[Piece]:
        """Wait until the vehicle itself is at the place, and slow."""
        while True:
            here = self._sees.pose()
            away = here.r_E - self._r
            off = math.hypot(away.x, away.y) if across else length(away)
            if off <= radius and length(here.v_E) <= SLOW:
                return
            yield self._still(self._r, CUT_S)

    # --- steps

    def _radius(self, step: Step) -> float:
        return step.radius if step.radius > 0.0 else self._sees.parameter("NAV_ACC_RAD")

    def _target(self, step: Step) -> Vec3:
        place = placed(step, self._sees.home())
        if place is None:
            return self._r
        z = place.z if math.isfinite(place.z) else self._r.z
        if step.do is not Do.LAND and z < self._sees.ground() + landing.CLEAR:
            z = self._sees.ground() + landing.ABOVE  # as a script's place in the ground
        across = math.isfinite(place.x) and math.isfinite(place.y)
        return Vec3(place.x, place.y, z) if across else Vec3(self._r.x, self._r.y, z)

    def _faces(self, step: Step, leg: Leg | None) -> None:
        """Take the heading of a step, or that of the leg to it unless a turn has set one."""
        if step.psi is not None:
            self._heading, self._has_turned = step.psi, False
        elif not self._has_turned:
            self._heading = None
        if leg is not None and leg.far * math.hypot(leg.ahead.x, leg.ahead.y) >= FACES_FROM:
            self._ahead = math.atan2(leg.ahead.y, leg.ahead.x)

    def _go_to(self, step: Step) -> Iterator[Piece]:
        """Fly to a place: through it in a curve, or to rest there."""
        yield from self._fly(step, self._target(step))

    def _next_place(self) -> Step | None:
        """The next place behind the current step, looked for once."""
        if self._to is None:
            self._to = self._mission.next_place()
        return self._to

    def _near(self, step: Step) -> Iterator[Piece]:
        """Fly on until the next place is as near as a step says, and through there. It does nothing if it is."""
        to = self._next_place()
        if to is None or self._sees.is_landed():
            return
        end = self._target(to)
        if to.do is Do.LAND:
            end = Vec3(end.x, end.y, self._r.z)
        far = length(end - self._r)
        short = max(step.value, abs(to.radius)) if to.do is Do.CIRCLE else step.value
        if far > short:
            yield from self._fly(step, end + (short / far) * (self._r - end))

    def _fly(self, step: Step, end: Vec3) -> Iterator[Piece]:
        led, radius = self._sees.limits(None), self._radius(step)
        leg = leg_of(self._r, end, led)
        self._faces(step, leg)
        corner = None
        if leg is not None:
            corner = self._corner(step, leg, radius, led)
            yield from self._along(
                straight(leg, leg.far - (corner.before if corner else 0.0), self._speed,
                         corner.speed if corner else 0.0)
            )  # fmt: skip
        if leg is not None and corner is not None:
            yield from self._round(leg, corner, end)
            return
        self._r, self._speed = end, 0.0
        yield from self._arrive(radius)
        if step.do is Do.LOITER:
            yield from self._stay(math.inf)
        if step.psi is not None or step.hold_s > 0.0:
            yield from self._stay(step.hold_s)

    def _corner(self, step: Step, leg: Leg, radius: float, led: PlanLimits) -> Corner | None:
        """The Corner in which the vehicle flies through a place. None if it stops there."""
        ahead = self._mission.ahead()
        flown_through = step.do in (Do.GO_TO, Do.NEAR) and step.hold_s == 0.0 and not step.stops
        if not flown_through or ahead is None:
            return None
        led_on = led if ahead.cruise is None else self._sees.limits(ahead.cruise)
        end = leg.start + leg.far * leg.ahead
        place = placed(ahead.step, self._sees.home())
        if place is None or not is_finite(place):
            return None
        if ahead.short > 0.0:  # the onward leg ends where the vehicle may have to stop
            onward_far = length(place - end)
            if onward_far <= ahead.short:
                return None
            place = place + (ahead.short / onward_far) * (end - place)
        onward = leg_of(end, place, led_on)
        if onward is None:
            return None
        room = (SHARE if self._speed == 0.0 else REMAINDER) * leg.far
        corner = corner_of(leg, onward, radius, room, led)
        if corner is None or not self._is_clear(leg, corner, end):
            return None
        far = (
            leg.far - corner.before
        )  # from the speed it has it must come down to that of the corner
        slowest = math.sqrt(max(self._speed * self._speed - 2.0 * leg.acceleration * far, 0.0))
        reached = math.sqrt(self._speed * self._speed + 2.0 * leg.acceleration * far)
        if slowest > corner.speed:
            return None
        if reached < corner.speed and corner.before > 0.0:
            bends = onward.ahead - leg.ahead
            for_s = 2.0 * corner.before / reached
            return Corner(corner.before, reached, for_s, (reached / for_s) * bends)
        return corner._replace(speed=min(corner.speed, reached))

    def _is_clear(self, leg: Leg, corner: Corner, end: Vec3) -> bool:
        """Tell whether the curve through a corner stays inside the fence."""
        enters = end - corner.before * leg.ahead
        begins = at(enters, 0.0, corner.speed * leg.ahead, corner.acceleration)
        # a chord of a parabola is a t^2 / 8 from it, of the time t that the chord takes
        bulge = 0.125 * length(corner.acceleration) * corner.for_s * corner.for_s
        n = min(MOST_CHORDS, max(CHORDS, math.ceil(math.sqrt(bulge / BULGE))))
        places = [carried(begins, k / n * corner.for_s).r_c for k in range(n + 1)]
        return all(self._sees.is_clear(a, b) for a, b in pairwise(places))

    def _round(self, leg: Leg, corner: Corner, end: Vec3) -> Iterator[Piece]:
        """The curve through a corner: its place is reached when the curve is over."""
        self._speed, self._r = corner.speed, end
        if corner.for_s > 0.0:
            enters = end - corner.before * leg.ahead
            begins = at(enters, 0.0, corner.speed * leg.ahead, corner.acceleration)
            yield from self._along([Piece(begins, corner.for_s)])
            whole: Setpoint = carried(begins, corner.for_s)
            self._r = whole.r_c

    def _climb(self, step: Step) -> Iterator[Piece]:
        """Take off, straight up to the height of a step, and at least by MIS_TAKEOFF_ALT."""
        here, led = self._sees.pose(), self._sees.limits(None)
        self._sees.takes_off()
        least = here.r_E.z + self._sees.parameter("MIS_TAKEOFF_ALT")
        place = placed(step, self._sees.home())
        z = least if place is None or not math.isfinite(place.z) else max(least, place.z)
        self._psi, self._ahead, self._heading = here.psi, here.psi, None
        led = led._replace(up=min(led.up, self._sees.parameter("MPC_TKO_SPEED")))
        up = Vec3(here.r_E.x, here.r_E.y, z)
        self._at_once = 0
        yield from plans.line(here.r_E, up, here.psi, led)
        self._r, self._speed, self._part = up, 0.0, 1.0
        yield from self._arrive(self._sees.parameter("NAV_ACC_RAD"))

    def _land(self, step: Step) -> Iterator[Piece]:
        """Fly over the place at the height that it has, wait for the vehicle, and come down."""
        if self._sees.is_landed():
            return
        place, led = self._target(step), self._sees.limits(None)
        over = Vec3(place.x, place.y, self._r.z)
        leg = leg_of(self._r, over, led)
        self._faces(step, leg)
        if leg is not None:
            yield from self._along(straight(leg, leg.far, self._speed, 0.0))
        self._r, self._speed = over, 0.0
        yield from self._arrive(OVER, across=True)
        yield from self._stay(0.0)
        self._mission.lands = True
        ground = placed(step, self._sees.home())
        low = ground.z if ground is not None and math.isfinite(ground.z) else self._sees.home().z
        speed = self._sees.parameter("MPC_LAND_SPEED")
        yield from plans.descent(over, STILL, self._psi, low + plans.SLOW_BELOW, speed, led)

    def _circle(self, step: Step) -> Iterator[Piece]:
        """Fly to the nearest point of a circle and round it so often, then to rest."""
        led = self._sees.limits(None)
        center, radius = self._target(step), abs(step.radius)
        speed = min(led.cruise, math.sqrt(CIRCLE_PART * led.acceleration * radius))
        circle = plans.Circle(center, radius, speed, step.radius > 0.0, plans.OrbitYaw.TANGENT)
        turns_s = 2.0 * math.pi * radius * step.value / speed
        flown, last = 0.0, at(self._r, self._psi)
        for piece in plans.orbit(
            self._r, self._psi, circle, min(TURNS, self._sees.yaw_rate()), led
        ):
            across = math.hypot(piece.setpoint.r_c.x - center.x, piece.setpoint.r_c.y - center.y)
            if abs(across - radius) < 1e-6 and length(piece.setpoint.v_c) > 0.0:
                flown += piece.for_s * length(piece.setpoint.v_c) / speed
            self._at_once = 0
            yield piece
            last = carried(piece.setpoint, piece.for_s)
            if flown >= turns_s:
                break
        self._psi = float(wrap(last.psi_c))
        self._ahead, self._heading = self._psi, None
        stopping, self._r = plans.brake(last.r_c, last.v_c, self._psi, led)
        self._speed = 0.0
        yield from self._along(stopping)

    def _turn(self, step: Step) -> Iterator[Piece]:
        """Turn in place: to a heading, or by an angle. It is kept until a place names another."""
        away = step.value if step.relative else float(wrap(step.value - self._psi))
        if step.way:
            sign = -1.0 if step.way > 0 else 1.0  # seen from above, counter-clockwise is positive
            away = sign * (abs(step.value) if step.relative else (sign * away) % (2.0 * math.pi))
        rate = min(TURNS, self._sees.yaw_rate())
        if abs(away) > TURNED and not self._sees.is_landed():
            for_s = abs(away) / rate
            turning = at(self._r, self._psi)._replace(psi_dot_c=math.copysign(rate, away))
            self._at_once = 0
            yield Piece(turning, for_s)
        self._psi = float(wrap(self._psi + away))
        self._look_at, self._heading, self._has_turned = None, self._psi, True
