"""Paths keep their limits, pass where they should, and begin and end at rest."""

import numpy as np
import pytest

from gcs_tools.missions import paths
from gcs_tools.missions.paths import Path, PathError

SQUARE = np.array(
    [[0, 0, 3], [10, 0, 3], [10, 10, 3], [0, 10, 5], [0, 0, 3]], dtype=np.float64
)  # fmt: skip
THERE_AND_BACK = np.array([[0, 0, 3], [10, 0, 3], [0, 0, 3]], dtype=np.float64)
SPEED, ACCELERATION = 3.0, 2.0


def made(kind: str, points: np.ndarray = SQUARE, speed: float = SPEED) -> Path:
    if kind == "spline":
        return paths.spline(points, speed, ACCELERATION)
    return paths.rounded(points, 0.5, speed, ACCELERATION)


def times(path: Path, n: int = 20001) -> np.ndarray:
    return np.linspace(0.0, path.duration_s, n)


COLLINEAR = np.array([[0, 0, 3], [10, 0, 3], [0, 0, 3], [10, 0, 3]], dtype=np.float64)
NEARLY_BACK = np.array([[0, 0, 3], [10, 0, 3], [0, 0.001, 3]], dtype=np.float64)


@pytest.mark.parametrize(
    ("kind", "points"),
    [
        ("rounded", SQUARE), ("spline", SQUARE), ("rounded", THERE_AND_BACK),
        ("spline", THERE_AND_BACK), ("spline", COLLINEAR), ("spline", NEARLY_BACK),
    ],
)  # fmt: skip
class TestOfAnyPath:
    def test_velocity_and_acceleration_are_those_of_its_place(self, kind, points) -> None:
        path = made(kind, points)
        t = times(path)
        r, v, a = path.at(t)
        assert np.abs(np.gradient(r, t, axis=0) - v)[1:-1].max() < 1e-3
        assert np.abs(np.gradient(v, t, axis=0) - a)[1:-1].max() < 0.1

    def test_a_path_keeps_to_its_limits_and_uses_them(self, kind, points) -> None:
        path = made(kind, points)
        _, v, a = path.at(times(path))
        assert 0.85 * SPEED < np.linalg.norm(v, axis=1).max() <= 1.001 * SPEED
        assert 0.85 * ACCELERATION < np.linalg.norm(a, axis=1).max() <= 1.01 * ACCELERATION

    def test_a_path_begins_and_ends_at_rest(self, kind, points) -> None:
        path = made(kind, points)
        r, v, _ = path.at(np.array([0.0, path.duration_s, path.duration_s + 60.0]))
        np.testing.assert_allclose(r, points[[0, -1, -1]], atol=1e-6)
        np.testing.assert_allclose(v, 0.0, atol=1e-6)

    def test_acceleration_along_a_path_does_not_jump(self, kind, points) -> None:
        path = made(kind, points)
        t = times(path)
        jerk = np.linalg.norm(np.diff(path.at(t).a, axis=0), axis=1) / np.diff(t)
        assert jerk.max() < 8.0 * ACCELERATION / paths.SMOOTH_S


@pytest.mark.parametrize("corner_m", [0.05, 0.5, 1.0])
def test_a_rounded_corner_passes_its_point_as_far_off_as_it_may(corner_m: float) -> None:
    path = paths.rounded(SQUARE, corner_m, SPEED, ACCELERATION)
    r = path.at(times(path)).r
    off = [np.linalg.norm(r - corner, axis=1).min() for corner in SQUARE[1:-1]]
    np.testing.assert_allclose(off, corner_m, rtol=1e-3)


def test_a_rounded_corner_takes_half_of_a_short_way_at_most() -> None:
    points = np.array([[0, 0, 3], [10, 0, 3], [10, 0.2, 3], [0, 0.2, 3]], dtype=np.float64)
    path = paths.rounded(points, 5.0, SPEED, ACCELERATION)
    r = path.at(times(path)).r
    assert r[:, 0].max() <= 10.0
    assert np.linalg.norm(r - [10, 0.1, 3], axis=1).min() < 0.02


@pytest.mark.parametrize("corner_m", [0.01, 0.02, 0.05])
@pytest.mark.computes
def test_a_narrow_corner_is_passed_slowly_and_slows_nothing_else(corner_m: float) -> None:
    path = paths.rounded(SQUARE, corner_m, SPEED, ACCELERATION)
    t = times(path, 100_001)
    v, a = path.at(t)[1:]
    assert np.linalg.norm(v, axis=1).max() > 0.95 * SPEED
    assert np.linalg.norm(a, axis=1).max() <= 1.01 * ACCELERATION
    steps = np.linalg.norm(np.diff(v, axis=0), axis=1) / np.diff(t)
    assert steps.max() <= 1.01 * ACCELERATION
    assert path.duration_s < 21.0  # 18.8 s of four lines with stops between them, and the means


def test_a_curve_that_turns_on_a_point_is_an_error() -> None:
    """Far to one point and hardly on to the next: the curve overshoots, and has to come back."""
    points = np.array(
        [[0.247, 0.207, 49.768], [-11.085, -0.443, 44.978], [-11.082, -0.443, 44.978]]
    )
    with pytest.raises(PathError, match="rounded") as raised:
        paths.spline(points, SPEED, ACCELERATION)
    assert raised.value.at == 1
    assert paths.rounded(points, 0.5, SPEED, ACCELERATION).duration_s < 10.0


def test_a_wider_corner_is_faster() -> None:
    narrow, wide = (
        paths.rounded(SQUARE, corner_m, SPEED, ACCELERATION).duration_s for corner_m in (0.1, 1.0)
    )
    assert wide < narrow - 2.0


def test_a_path_stands_where_it_turns_back() -> None:
    path = made("rounded", THERE_AND_BACK)
    r, v, _ = path.at(times(path))
    i = int(r[:, 0].argmax())
    assert abs(r[i, 0] - 10.0) < 1e-6
    assert np.linalg.norm(v[i]) < 1e-3


def test_a_spline_passes_every_point() -> None:
    path = made("spline")
    r = path.at(times(path, 200_001)).r
    assert max(np.linalg.norm(r - point, axis=1).min() for point in SQUARE) < 1e-3


def test_a_straight_line_takes_the_time_of_a_trapezoid_and_of_its_mean() -> None:
    path = paths.rounded(SQUARE[:2], 0.5, 2.0, 1.0)
    assert path.duration_s == pytest.approx(10.0 / 2.0 + 2.0 / 1.0 + paths.SMOOTH_S, abs=0.02)


def circle(noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(3.0, 13.0, 201)
    p = 0.8 * (t - 3.0)
    points = np.stack([4 * np.cos(p), 4 * np.sin(p), np.full(len(t), 6.0)], axis=1)
    return t, points + np.random.default_rng(1).normal(0.0, noise, points.shape)


def test_a_recorded_track_is_flown_in_its_time() -> None:
    t, points = circle()
    path = paths.recorded(t, points, 0.0, 5.0)
    assert path.duration_s == pytest.approx(10.0)
    found = path.at(t - 3.0)
    np.testing.assert_allclose(found.r, points, atol=1e-9)
    assert np.linalg.norm(found.v[100]) == pytest.approx(3.2, abs=1e-3)
    assert np.linalg.norm(found.a[100]) == pytest.approx(0.8 * 3.2, abs=1e-2)


def test_noise_of_a_track_is_smoothed_as_far_as_it_may_miss() -> None:
    t, noisy = circle(0.02)
    with pytest.raises(PathError, match="smooth_m"):
        paths.recorded(t, noisy, 0.0, 5.0)
    found = paths.recorded(t, noisy, 0.04, 5.0).at(t - 3.0)
    off = np.linalg.norm(found.r - noisy, axis=1)
    assert np.sqrt((off**2).mean()) <= 0.0401
    inner = slice(20, -20)
    assert np.linalg.norm(found.r - circle()[1], axis=1)[inner].max() < 0.04
    assert np.linalg.norm(noisy - circle()[1], axis=1)[inner].max() > 0.05


def test_what_is_no_path_is_said_to_be_none() -> None:
    t, points = circle()
    for of, at in (
        (lambda: paths.rounded(SQUARE[[0, 1, 1]], 0.5, 3.0, 2.0), 2),
        (lambda: paths.spline(SQUARE[[0, 0]], 3.0, 2.0), 1),
        (lambda: paths.rounded(1e5 * SQUARE, 0.5, 0.01, 2.0), None),
        (lambda: paths.spline(SQUARE, 3.0, 1e-7), None),
        (lambda: paths.recorded(t[::-1], points, 0.0, 5.0), 1),
        (lambda: paths.recorded(t[:3], points[:3], 0.0, 5.0), 2),
    ):
        with pytest.raises(PathError) as raised:
            of()
        assert raised.value.at == at
