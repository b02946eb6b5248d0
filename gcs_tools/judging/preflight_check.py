"""Whether a vehicle would fly a mission's setpoints as they are written, known before it flies.

Looked at as the vehicle looks at each when it arrives: from where the reference model (34) is
then, which is the mission's alone to say where the guard refuses; governed, also the mass's and the
air's to say, by a little. What the vehicle will demand by then is the air's to say, so it counts for
nothing here: in the air more may be admitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission
from fcu.guard.gains import why_refused
from fcu.guard.parameters import REFUSE
from fcu.interface.files.input_file import written
from fcu.interface.messages import PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told, lacks, words
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.mavlink.frames import through_the_wire
from fcu.parameters import Parameters
from fcu.vehicle.areas import Area
from fcu.vehicle.feasibility_check import FeasibilityCheck
from fcu.vehicle.fence import Fence
from fcu.vehicle.mission import Step
from fcu.vehicle.plan_check import Ground, along
from fcu.vehicle.plans import STILL, Pose, limits
from fcu.vehicle.setpoints import of_position, script_limits
from gcs_tools.flight.item_script import SEND_AGAIN_S
from gcs_tools.flight.scenario import Scenario
from gcs_tools.judging.expectations import LIMITED
from gcs_tools.judging.item_checks import good_endings
from gcs_tools.judging.setpoint_checks import coordinates, grounded
from gcs_tools.missions.mission import Mission


class Looked(NamedTuple):
    """What the vehicle sees of a setpoint when it arrives."""

    at_s: float  # when it is sent
    setpoint: Setpoint
    tightest: admission.Tightest
    reference: admission.Buffer  # float64[9], r_m, v_m and a_m of then


def as_sent(setpoint: Setpoint) -> Setpoint:
    """Itself."""
    return setpoint


def looks(
    scene: Scenario, settings: Any, changed: Callable[[Setpoint], Setpoint] = as_sent
) -> Iterator[Looked]:
    """At each setpoint of a mission that leads another way than the one before; each flown, refused or not.

    settings : of law and guard, in place of its own.  changed : what is made of each setpoint first.
    """
    law, guard = settings
    look = admission.Look(guard, law)
    guard_buffer, law_buffer = to_buffer(guard), to_buffer(law)
    start = through_the_wire(scene.begin)
    reference = np.array([*start.r_E, *start.v_E, 0.0, 0.0, 0.0])
    before = None
    for k, row in zip(scene.sent_at.tolist(), scene.setpoints, strict=True):
        setpoint = changed(from_buffer(Setpoint, row))
        if before is not None:
            past = to_buffer(before[1])
            admission.follow(guard_buffer, law_buffer, past, k - before[0], reference)
        if before is None or not admission.is_same_way(setpoint, before[1]):
            found = look.tightest(admission.way_to(setpoint), reference)
            yield Looked(k / scene.rate_hz, setpoint, found, reference)
        if before is None:  # it takes over there
            reference[:3] += law.initial.r_m_offset
        before = k, setpoint


@dataclass(frozen=True)
class Unflyable:
    """A setpoint that no vehicle flies as it is written."""

    at_s: float
    position_m: Vec3
    why: str  # far, low, fast, hard, turns: of LIMITS; ground, arena
    text: str  # a sentence
    expected: bool  # [expect] says so


LIMITS = {  # of the vehicle: why, and what sets it
    Code.SETPOINT_FAR: ("far", "MR_SP_DIST"),
    Code.SETPOINT_LOW: ("low", "MR_SP_BELOW"),
    Code.SETPOINT_FAST: ("fast", "MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP, MPC_Z_VEL_MAX_DN"),
    Code.SETPOINT_HARD: ("hard", "1 g"),
    Code.SETPOINT_TURNS: ("turns", "law.yaw_rate_max"),
}


def unflyable(mission: Mission, scene: Scenario) -> tuple[Unflyable, ...]:
    """Setpoints of a mission that cannot be flown as written, each for one reason.

    Of those for one place, and of a curve, the first for each reason. How far away one is depends on
    where the vehicle is then: on its reference model, in still air.
    """
    found: dict[tuple[str, Vec3 | None], Unflyable] = {}
    start, flight = scene.world.start.r_E, mission.flight
    expect = mission.expectations()
    badly = expect.get("ended") not in (
        None,
        *good_endings(flight),
    )  # then nothing else is expected
    limited = expect.get(LIMITED) is True or (badly and LIMITED not in expect)
    refused = first_refused(scene)
    seen_until_s = math.inf if refused is None else refused.at_s
    for at_s, asked, told in _received(scene):
        r = asked.r_c
        here = f"setpoint at {at_s:g} s, {coordinates(r)}"
        reasons = []
        if (away := math.dist(r, start)) > flight.arena_m:
            text = (
                f"{away:.4g} m from the start: a flight ends as diverged beyond {flight.arena_m:g} m"
                " (raise flight.arena_m)"
            )
            reasons.append(("arena", text, badly))
        if below := grounded(flight, r):
            reasons.append(("ground", below, limited))
        elif told is not None and at_s <= seen_until_s:
            which, sets = LIMITS[told.code]
            reasons.append((which, f'limited: "{words(told)}" ({sets})', limited))
        for why, text, expected in reasons:
            moves = asked.v_c != STILL or asked.a_c != STILL  # along a curve or a path
            once = why, None if moves else r
            found.setdefault(once, Unflyable(at_s, r, why, f"{here}, {text}", expected))
    return tuple(found.values())


def _received(scene: Scenario) -> Iterator[tuple[float, Setpoint, Told | None]]:
    """Each setpoint that a script sends: when (s), as asked for, and what the vehicle limits of it."""
    law, guard = scene.settings
    guard_buffer, law_buffer = to_buffer(guard), to_buffer(law)
    limits = script_limits(Parameters(scene.settings, 1, None, scene.flown, scene.airframe))
    start = through_the_wire(scene.begin)
    home = scene.world.start.r_E
    reference = np.array([*start.r_E, *start.v_E, 0.0, 0.0, 0.0])
    again = max(1, round(SEND_AGAIN_S * scene.rate_hz))
    for begins, ends, row in zip(
        scene.sent_at.tolist(), [*scene.sent_at.tolist()[1:], scene.planned_ticks], scene.setpoints, strict=True
    ):  # fmt: skip
        asked = from_buffer(Setpoint, row)
        request = PositionRequest(asked.r_c, asked.v_c, asked.a_c, asked.psi_c, asked.psi_dot_c)
        for k in range(begins, ends, again):
            r, v = (Vec3(*reference[i : i + 3].tolist()) for i in (0, 3))
            made, told = of_position(request, Pose(r, v, asked.psi_c), home, asked, limits)
            yield k / scene.rate_hz, asked, told
            ticks = min(again, ends - k)
            admission.follow(guard_buffer, law_buffer, to_buffer(made), ticks, reference)
            if k == 0:  # it takes over there
                reference[:3] += law.initial.r_m_offset


def refused_gains(mission: Mission, scene: Scenario) -> str:
    """Why a vehicle refuses the gains of a mission, with the file and line of each. Empty if it flies them."""
    channel = scene.unstable
    if not channel:
        return ""
    given = [
        (key, each)
        for key, each in mission.values_in_force().items()
        if key.startswith("law.") and each.origin != "default"
    ]
    given.sort(key=lambda item: item[1].origin == mission.airframe.path.name)  # what it pins last
    chosen = {
        key.removeprefix("law."): f"{written(each.value)} ({mission.placed(key, each.origin)})"
        for key, each in given
    }
    why = why_refused(scene.flown, channel, chosen)
    return f'{mission.source}: [law] {why}. [law] unstable_gains = "fly" flies them all the same'


def first_refused(scene: Scenario) -> Looked | None:
    """The first setpoint that the vehicle would refuse; what comes after it is another flight."""
    if scene.flown.guard is None or scene.guard.policy != REFUSE:
        return None
    return next((each for each in looks(scene, scene.settings) if each.tightest.margin < 0.0), None)


def refusal(scene: Scenario, expected: bool = False) -> str:
    """Which of its setpoints would be refused, and why; empty if none.

    expected : whether the mission says that one is; then only of the first, without which no flight
    begins.
    """
    found = first_refused(scene)
    if found is None or (expected and found.at_s > 0.0):
        return ""
    at_s, setpoint, tightest, reference = found
    look = admission.Look(scene.guard, scene.law)
    lack = admission.lack_of(look, setpoint, -tightest.margin, reference)
    why = f"setpoint at {at_s:g} s refused: {words(lacks(*lack))}"
    return f"{why}; no flight begins with a refused setpoint" if expected else why


def margins_along(
    scene: Scenario, steps: tuple[Step, ...], areas: tuple[Area, ...]
) -> Iterator[tuple[int, admission.Tightest]]:
    """The margin on parts of the way to each item of a plan from home, as the vehicle looks along it.

    Whatever the guard's policy is. areas : of the fence, in which corners are not rounded where that would leave it.
    """
    params = Parameters(scene.settings, 1, None, scene.flown, scene.airframe)
    check, fence, home = FeasibilityCheck(params), Fence(), STILL
    fence.areas = areas
    begin = Ground(
        pose=Pose(home, STILL, 0.0), landed=scene.flight.start.on_ground, home=home,
        is_clear=fence.is_clear, parameter=params.__getitem__,
        limits=lambda cruise: limits(params, cruise, check.pace),
    )  # fmt: skip
    for each in along(steps, begin, check.look_anyhow):
        if each is not None:
            yield each.item, each.tightest
