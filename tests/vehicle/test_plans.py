"""Plans of constant acceleration: continuous, within their limits, and where they should end."""

from __future__ import annotations

import itertools
import math

import pytest

from fcu.kernel.algebra import Vec3
from fcu.laws.setpoint import carried
from fcu.vehicle import plans
from fcu.vehicle.plans import PlanLimits, length

LIMITS = PlanLimits(cruise=5.0, up=3.0, down=1.5, acceleration=3.0, acceleration_up=2.0)
HERE = Vec3(1.0, -2.0, 10.0)
STILL = Vec3(0.0, 0.0, 0.0)


def end_of(piece):
    return carried(piece.setpoint, piece.for_s)


def assert_continuous(pieces):
    for before, after in itertools.pairwise(pieces):
        end = end_of(before)
        assert length(end.r_c - after.setpoint.r_c) < 1e-9
        assert length(end.v_c - after.setpoint.v_c) < 1e-9


@pytest.mark.parametrize(
    "to",
    [
        Vec3(40.0, 0.0, 0.0),
        Vec3(0.4, -0.3, 0.0),
        Vec3(0.0, 0.0, 20.0),
        Vec3(0.0, 0.0, -6.0),
        Vec3(12.0, 9.0, -30.0),
    ],
)
def test_a_line_is_continuous_within_its_limits_and_ends_there_at_rest(to):
    pieces = plans.through(HERE, STILL, [HERE + to], 0.3, LIMITS)
    assert_continuous(pieces)
    assert pieces[0].setpoint.r_c == HERE
    assert length(pieces[0].setpoint.v_c) == 0.0
    last = pieces[-1]
    assert math.isinf(last.for_s)
    assert length(last.setpoint.r_c - (HERE + to)) < 1e-9
    assert last.setpoint.v_c == STILL
    for piece in pieces[:-1]:
        for setpoint in (piece.setpoint, end_of(piece)):
            v, a = setpoint.v_c, setpoint.a_c
            assert math.hypot(v.x, v.y) < LIMITS.cruise + 1e-9
            assert -LIMITS.down - 1e-9 < v.z < LIMITS.up + 1e-9
            assert math.hypot(a.x, a.y) < LIMITS.acceleration + 1e-9
            assert abs(a.z) < LIMITS.acceleration_up + 1e-9
            assert setpoint.psi_c == 0.3


def test_a_long_line_takes_the_time_of_a_trapezoid():
    pieces = plans.through(HERE, STILL, [HERE + Vec3(40.0, 0.0, 0.0)], 0.0, LIMITS)
    assert sum(p.for_s for p in pieces[:-1]) == pytest.approx(40.0 / 5.0 + 5.0 / 3.0)


def test_braking_stops_after_v_squared_over_2a():
    pieces = plans.through(HERE, Vec3(6.0, 0.0, 0.0), [], 0.0, LIMITS)
    assert_continuous(pieces)
    assert pieces[-1].setpoint.r_c.x - HERE.x == pytest.approx(36.0 / (2.0 * 3.0))
    assert pieces[0].for_s == pytest.approx(2.0)


def test_a_descent_is_fast_while_high_and_ends_in_a_slow_sink():
    pieces = plans.descent(HERE, STILL, 0.0, 4.0, 0.7, LIMITS)
    assert_continuous(pieces)
    begins, sink = pieces[-2].setpoint, pieces[-1].setpoint
    assert begins.r_c.z == pytest.approx(4.0)
    assert sink.v_c == Vec3(0.0, 0.0, -0.7)
    assert min(p.setpoint.v_c.z for p in pieces) == pytest.approx(-1.5)
    low = plans.descent(HERE, STILL, 0.0, 12.0, 0.7, LIMITS)
    assert [p.setpoint.v_c.z for p in low] == [0.0, -0.7]


def test_settling_holds_the_end_for_a_while():
    pieces = plans.through(HERE, STILL, [HERE + Vec3(0.0, 0.0, 2.0)], 0.0, LIMITS, settle_s=4.0)
    assert [p.for_s for p in pieces[-2:]] == [4.0, math.inf]
    assert pieces[-2].setpoint == pieces[-1].setpoint


def test_steps_go_there_and_back():
    plan = plans.steps(HERE, Vec3(5.0, 0.0, 0.0), 10.0, 0.0)
    there, back, again = itertools.islice(plan, 3)
    assert [p.setpoint.r_c.x for p in (there, back, again)] == [6.0, 1.0, 6.0]
    assert there.for_s == 10.0


def test_the_figure_of_eight_starts_from_rest_and_crosses_at_its_speed():
    pieces = list(itertools.islice(plans.figure_eight(HERE, (10.0, 5.0), 3.0, 0.0), 1000))
    assert length(pieces[0].setpoint.v_c) == 0.0
    for before, after in itertools.pairwise(pieces):
        end = end_of(before)
        assert length(end.r_c - after.setpoint.r_c) < 1e-3
        assert length(end.v_c - after.setpoint.v_c) < 0.02
    full = [p for p in pieces if length(p.setpoint.r_c - HERE) < 0.1][1:]
    assert max(length(p.setpoint.v_c) for p in full) == pytest.approx(3.0, abs=0.01)
    assert max(p.setpoint.r_c.x - HERE.x for p in pieces) == pytest.approx(5.0, abs=0.01)
    assert max(p.setpoint.r_c.y - HERE.y for p in pieces) == pytest.approx(2.5, abs=0.01)


def circle(clockwise=True, yaw=plans.OrbitYaw.CENTER):
    center = HERE + Vec3(3.0, 4.0, 2.0)
    return plans.Circle(center=center, radius=10.0, speed=4.0, clockwise=clockwise, yaw=yaw)


def flown_round(of, n=800):
    return list(itertools.islice(plans.orbit(HERE, 0.3, of, 0.8, LIMITS), n))


@pytest.mark.parametrize("clockwise", [True, False])
def test_an_orbit_keeps_its_radius_speed_and_direction(clockwise):
    of = circle(clockwise)
    pieces = flown_round(of)
    for before, after in itertools.pairwise(pieces):
        end = end_of(before)
        assert length(end.r_c - after.setpoint.r_c) < 1e-4
        assert length(end.v_c - after.setpoint.v_c) < 5e-3
        turned = math.remainder(end.psi_c - after.setpoint.psi_c, 2.0 * math.pi)
        assert abs(turned) < 5e-3
    for piece in pieces[-100:]:  # at full speed
        r, v, a = piece.setpoint.r_c - of.center, piece.setpoint.v_c, piece.setpoint.a_c
        assert length(r) == pytest.approx(10.0, abs=1e-9)
        assert length(v) == pytest.approx(4.0, abs=1e-9)
        assert a.x == pytest.approx(-0.16 * r.x, abs=1e-9)  # v^2 / r^2, towards the centre
        assert a.y == pytest.approx(-0.16 * r.y, abs=1e-9)
        assert (r.x * v.y - r.y * v.x < 0.0) is clockwise
        assert piece.setpoint.psi_dot_c == pytest.approx(-0.4 if clockwise else 0.4)
    assert plans.orbit_acceleration(of) == pytest.approx(1.6)


def test_an_orbit_is_entered_at_the_nearest_point_of_its_circle():
    of = circle()
    entry = next(p for p in flown_round(of) if p.for_s == 1.0 / plans.ORBIT_HZ).setpoint
    # from 5 m beside the centre straight away from it, and up to its height
    assert length(entry.r_c - (of.center + Vec3(-6.0, -8.0, 0.0))) < 1e-9
    assert entry.v_c == STILL


def test_an_orbit_begun_at_its_centre_is_entered_ahead():
    of = circle()._replace(center=HERE)
    entry = next(p for p in flown_round(of) if p.for_s == 1.0 / plans.ORBIT_HZ).setpoint
    ahead = Vec3(10.0 * math.cos(0.3), 10.0 * math.sin(0.3), 0.0)
    assert length(entry.r_c - (HERE + ahead)) < 1e-9


@pytest.mark.parametrize(
    ("yaw", "clockwise", "ahead"),
    [
        (plans.OrbitYaw.CENTER, True, lambda r, v: (-0.1) * r),
        (plans.OrbitYaw.TANGENT, True, lambda r, v: 0.25 * v),
        (plans.OrbitYaw.TANGENT, False, lambda r, v: 0.25 * v),
        (plans.OrbitYaw.INITIAL, True, lambda r, v: Vec3(math.cos(0.3), math.sin(0.3), 0.0)),
    ],
)
def test_an_orbit_faces_as_it_is_asked(yaw, clockwise, ahead):
    of = circle(clockwise, yaw)
    last = flown_round(of)[-1].setpoint
    expected = ahead(last.r_c - of.center, last.v_c)
    faces = Vec3(math.cos(last.psi_c), math.sin(last.psi_c), 0.0)
    assert length(faces - expected) < 1e-9
