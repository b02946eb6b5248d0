"""Layers of wind by themselves: turbulence against the standards' spectra, shear, gusts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel
from sitl_plant.physics.wind import air, draws, gusts, low_altitude, shear, von_karman
from sitl_plant.physics.wind.air import Turbulence

W20, HEIGHT, SECONDS = 15.4, 20.0, 1000.0  # moderate, m/s; m; s


def flown(kind: float, rate: int, speed: float, seed: int = 1) -> np.ndarray:
    """float64[n, 3]: turbulence that a vehicle meets at a mean airspeed."""
    out = np.zeros((round(SECONDS * rate), 3))
    _fly(
        np.zeros(von_karman.STATES + 1),
        np.zeros(air.NORMALS),
        Turbulence(kind, W20, float(seed), 1.0, 0.0),
        speed,
        1.0 / rate,
        out,
    )
    return out


@kernel
def _fly(memory, normals, of, speed, dt, out):
    for k in range(len(out)):
        v = air.turbulent(
            memory, normals, of, HEIGHT, Vec3(speed, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), dt, k
        )
        out[k, 0], out[k, 1], out[k, 2] = v.x, v.y, v.z


def spectrum(kind: float, axis: int, f, speed: float):
    """The standard's one-sided spectrum (m^2/s^2 per Hz) of a component. MIL-F-8785C, 3.7.1."""
    here = low_altitude.at_height(HEIGHT, W20)
    V = low_altitude.advection(Vec3(speed, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), here.sigma)
    sigma, tau = here.sigma[axis], here.length[axis] / V
    w = 2.0 * math.pi * np.asarray(f) * tau
    if kind == air.DRYDEN:
        shape = 2.0 / (1.0 + w**2) if axis == 0 else (1.0 + 3.0 * w**2) / (1.0 + w**2) ** 2
    else:
        a = (1.339 * w) ** 2
        shape = (
            2.0 / (1.0 + a) ** (5 / 6)
            if axis == 0
            else (1.0 + 8.0 / 3.0 * a) / (1.0 + a) ** (11 / 6)
        )
    return 2.0 * math.pi * sigma**2 * tau / math.pi * shape


CASES = [(rate, speed) for rate in (250, 1000, 4000) for speed in (0.0, 4.0, 20.0)]


@pytest.mark.parametrize("kind", [air.DRYDEN, air.VON_KARMAN])
@pytest.mark.parametrize(("rate", "speed"), CASES)
@pytest.mark.computes
def test_spectra_are_those_of_the_standard_at_every_step_and_speed(kind, rate, speed):
    """In bands of a third of a decade, within four deviations of the estimate, and what the filters leave.

    Five Dryden processes are within 2.5 % of von Karman's spectra. Welch's window leaks where a spectrum is steep.
    """
    v = flown(kind, rate, speed)
    n = round(100.0 * rate)
    f, found = signal.welch(v, rate, "hann", nperseg=n, noverlap=n // 2, axis=0, detrend=False)
    windows = 2 * SECONDS / 100.0 - 1
    for low in np.geomspace(0.05, 1.5, 5)[:-1]:
        band = (f >= low) & (f < 2.15 * low)
        for axis in range(3):
            ratio = np.mean(found[band, axis] / spectrum(kind, axis, f[band], speed))
            # a Hann window makes neighbours alike: about half of the bins are independent
            deviation = 1.0 / math.sqrt(0.5 * windows * band.sum() / 1.5)
            bias = 0.0 if kind == air.DRYDEN else 0.025
            assert abs(ratio - 1.0) < 4.0 * deviation + bias + 0.03, (axis, low, ratio)


@pytest.mark.parametrize("kind", [air.DRYDEN, air.VON_KARMAN])
@pytest.mark.parametrize("rate", [250, 1000, 4000])
@pytest.mark.computes
def test_variances_are_those_of_the_standard(kind, rate):
    """Of three seeds at 20 m/s, within four deviations of what 1,000 s can tell."""
    here = low_altitude.at_height(HEIGHT, W20)
    variance = np.mean([flown(kind, rate, 20.0, seed).var(axis=0) for seed in (1, 2, 3)], axis=0)
    for axis in range(3):
        tau = here.length[axis] / 20.0
        deviation = math.sqrt(2.0 * tau / (3 * SECONDS)) * math.sqrt(2.0)
        ratio = variance[axis] / here.sigma[axis] ** 2
        assert abs(ratio - 1.0) < 4.0 * deviation, (axis, ratio, deviation)


@pytest.mark.parametrize("kind", [air.DRYDEN, air.VON_KARMAN])
@pytest.mark.computes
def test_a_seed_gives_the_same_bits_and_another_gives_others(kind):
    one, again, other = (flown(kind, 250, 4.0, seed) for seed in (5, 5, 6))
    assert one.tobytes() == again.tobytes()
    assert abs(np.corrcoef(one[:, 2], other[:, 2])[0, 1]) < 0.2


@pytest.mark.parametrize("kind", [air.DRYDEN, air.VON_KARMAN])
def test_turbulence_begins_as_it_goes_on(kind):
    """Its first value has the variance of all: over 4,000 seeds, within four deviations of the estimate."""
    here = low_altitude.at_height(HEIGHT, W20)
    first = np.zeros((4000, 3))
    for seed in range(len(first)):
        _fly(
            np.zeros(von_karman.STATES + 1),
            np.zeros(air.NORMALS),
            Turbulence(kind, W20, float(seed), 1.0, 0.0),
            4.0,
            0.002,
            first[seed : seed + 1],
        )
    ratio = first.var(axis=0) / np.square(here.sigma)
    assert (abs(ratio - 1.0) < 4.0 * math.sqrt(2.0 / 4000)).all(), ratio


def test_at_hover_turbulence_goes_on_at_the_speed_of_its_own_eddies():
    here = low_altitude.at_height(HEIGHT, W20)
    still = Vec3(0.0, 0.0, 0.0)
    assert low_altitude.advection(still, still, here.sigma) == here.sigma.x
    assert low_altitude.advection(Vec3(9.0, 0.0, 0.0), still, here.sigma) == 9.0


def test_scales_are_the_standards_at_20_ft_and_1000_ft():
    """MIL-F-8785C: at 1,000 ft all three intensities and lengths are alike, and sigma_w = 0.1 W20."""
    top = low_altitude.at_height(1000 * 0.3048, 10.0)
    np.testing.assert_allclose(top.sigma, 1.0, rtol=1e-3)
    np.testing.assert_allclose(top.length, 304.8, rtol=1e-3)
    low = low_altitude.at_height(20 * 0.3048, 10.0)
    assert low.length.z == pytest.approx(6.096)
    assert low.sigma.x == pytest.approx(1.0 / (0.177 + 0.000823 * 20) ** 0.4)
    assert low_altitude.at_height(0.0, 10.0) == low_altitude.at_height(3.048, 10.0)


def test_normal_numbers_are_normal_and_independent():
    n = np.array([draws.normals(3.0, k, p) for k in range(20_000) for p in range(2)]).reshape(
        20_000, 4
    )
    assert np.abs(n.mean(axis=0)).max() < 4.0 / math.sqrt(20_000)
    assert np.abs(n.var(axis=0) - 1.0).max() < 4.0 * math.sqrt(2.0 / 20_000)
    correlated = np.corrcoef(n.T) - np.eye(4)
    assert np.abs(correlated).max() < 4.0 / math.sqrt(20_000)
    assert np.abs(np.corrcoef(n[1:, 0], n[:-1, 0])[0, 1]) < 4.0 / math.sqrt(20_000)


def test_shear_is_one_at_its_reference_and_nothing_at_the_ground():
    for kind in (shear.LOG, shear.POWER):
        assert shear.factor(kind, 10.0, 10.0, 0.1, 1 / 7) == pytest.approx(1.0)
        assert shear.factor(kind, 0.0, 10.0, 0.1, 1 / 7) == 0.0
        assert shear.factor(kind, -1.0, 10.0, 0.1, 1 / 7) == 0.0
    assert shear.factor(shear.LOG, 40.0, 10.0, 0.1, 0.0) == pytest.approx(
        math.log(400) / math.log(100)
    )
    assert shear.factor(shear.POWER, 40.0, 10.0, 0.1, 0.25) == pytest.approx(4.0**0.25)
    assert shear.factor(shear.NONE, 1.0, 10.0, 0.1, 0.25) == 1.0


def test_a_gust_rises_as_one_minus_cosine_holds_and_falls():
    rows = np.array([[1.0, 0.5, 2.0, 1.0, 4.0, 0.0, -2.0]])
    at = {0.9: 0.0, 1.0: 0.0, 1.25: 0.5, 1.5: 1.0, 3.4: 1.0, 4.0: 0.5, 4.5: 0.0, 9.0: 0.0}
    for t, share in at.items():
        assert gusts.velocity(rows, t) == pytest.approx((4.0 * share, 0.0, -2.0 * share)), t
    slope = (
        gusts.share(0.25 + 1e-6, 0.5, 0.0, 0.5) - gusts.share(0.25 - 1e-6, 0.5, 0.0, 0.5)
    ) / 2e-6
    assert slope == pytest.approx(math.pi / (2 * 0.5), rel=1e-6)
