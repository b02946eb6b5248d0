"""The law as it is flown: the believed airframe, its limits, a measurement, one tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fcu
from fcu.interface.airframe import Airframe, airframe, load
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rotations import from_euler
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.types import Params, State
from fcu.process.settings import Settings, settings
from fcu.process.tick import FLYING, TAKE_OVER, Remembered, Tick, tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import prepared
from gcs_tools.flight.scenario import Scenario
from tests.laws.values import dtype, with_fields

Floats = np.ndarray[Any, np.dtype[np.float64]]

OCTO = load(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
ZERO = Vec3(0.0, 0.0, 0.0)
# what the law is tested with, whatever a vehicle begins with: Section VIII, and a wide set of masses
PAPER = {
    "f_m": 1.0, "gamma": 1000.0, "c_angle": 10.0, "c_rate": 20.0, "m_hat_0": 5.0, "J_hat_0": 0.1,
    "bounds.m_min": 1.0, "bounds.m_max": 20.0, "T_dz_min": 20.0, "sigma_v": 0.0,
}  # fmt: skip


@pytest.fixture(scope="session")
def believed() -> Airframe:
    return airframe(OCTO["rotors"], "s1000.toml")


@pytest.fixture(scope="session")
def settings_of(believed: Airframe) -> Callable[..., Settings]:
    """Settings of the octocopter: `settings_of(f_m=1.4)`, `settings_of(guard="warn")`."""

    def build(rate_hz: float = 500.0, **chosen: Any) -> Settings:
        return settings(
            believed, OCTO, rate_hz, chosen if "prediction" in chosen else {**PAPER, **chosen}
        )

    return build


@pytest.fixture(scope="session")
def law(settings_of: Callable[..., Settings]) -> Callable[..., Params]:
    """Params of the octocopter: `law(f_m=1.4)`, `law(rate_hz=250.0, prediction="demanded")`."""

    def build(rate_hz: float = 500.0, **chosen: Any) -> Params:
        return settings_of(rate_hz, **chosen).law

    return build


@pytest.fixture(scope="session")
def hover() -> Callable[..., VehicleState]:
    """A measurement: at rest at the origin, eight rotors carrying 8 kg, but for what is named."""

    def build(
        r: Any = ZERO,
        v: Any = ZERO,
        angles: Any = (0.0, 0.0, 0.0),
        w: Any = ZERO,
        weight: float = 8.0 * 9.81,
    ) -> VehicleState:
        Omega = math.sqrt(weight / 8.0 / 8.2e-5)
        q_EB = from_euler(*[float(a) for a in angles])
        return VehicleState(_vec3(r), _vec3(v), q_EB, _vec3(w), Rotors(*[Omega] * 8))

    return build


@pytest.fixture(scope="session")
def fixed() -> Callable[..., Setpoint]:
    """A setpoint that stands still."""

    def build(r: Any = ZERO, psi: float = 0.0) -> Setpoint:
        return Setpoint(_vec3(r), ZERO, ZERO, float(psi), 0.0)

    return build


def _vec3(row: Any) -> Vec3:
    return Vec3(*np.asarray(row, dtype=float).tolist())


@pytest.fixture(scope="session")
def random_state(hover: Callable[..., VehicleState]) -> Callable[..., State]:
    """A State whose estimates lie at random, well inside their sets."""

    def build(params: Params, rng: np.random.Generator) -> State:
        return with_fields(
            mmrac.beginning(params, hover()),
            v_hat=_vec3(rng.normal(size=3)),
            s_v_hat=_vec3(rng.normal(size=3)),
            m_hat=float(rng.uniform(4.0, 12.0)),
            w_hat=_vec3(rng.normal(size=3)),
            s_w_hat=_vec3(rng.normal(size=3)),
            J_hat=_vec3(rng.uniform(0.1, 1.0, 3)),
            c_p1_hat=float(rng.normal()),
            c_p2_hat=float(rng.normal() * 1e-3),
            c_q1_hat=float(rng.normal()),
            c_q2_hat=float(rng.normal() * 1e-3),
            c_r1_hat=float(rng.normal()),
            f_c=_vec3(rng.normal(size=3) * 5.0),
        )

    return build


class Told(Scenario):
    """A flight by setpoints that no mission sends; what the wire would round is not rounded."""

    @property
    def setpoints(self) -> Floats:
        return np.array([to_buffer(setpoint) for setpoint in self.sent])


@pytest.fixture(scope="session")
def told() -> Callable[..., Told]:
    """A flight in the world of paper_nominal: `told([(0.0, here), (3.0, there)], 6.0)`."""

    def build(
        sent: Sequence[tuple[float, Setpoint]],
        seconds: float,
        rate_hz: float = 500.0,
        wind: bool = False,
        settings: Sequence[str] = (),
        law: str | None = None,
    ) -> Told:
        still = [] if wind else ["wind.amplitude_m_s=[0,0,0]"]
        _, scene = prepared("paper_nominal", [*still, *settings], rate_hz=rate_hz, law=law)
        given = {field.name: getattr(scene, field.name) for field in fields(scene)} | {
            "ticks": round(seconds * rate_hz),
            "sent_at": np.array([round(t * rate_hz) for t, _ in sent]),
            "sent": tuple(setpoint for _, setpoint in sent),
        }
        return Told(**given)

    return build


@pytest.fixture(scope="session")
def flight(told: Callable[..., Told]) -> Callable[..., Any]:
    """Rows of a flight as `told`, by name: structured, of the dtype of the law's Tick."""

    def fly(*args: Any, **kwargs: Any) -> Any:
        scene = told(*args, **kwargs)
        _, rows = law_alone.fly(scene)
        return rows.view(dtype(scene.flown.ticks.Tick))[:, 0]

    return fly


class Ticks:
    """Law and guard on their buffers, tick after tick, as a process runs them."""

    def __init__(self, settings: Settings) -> None:
        self.settings = to_buffer(settings)
        self.row = np.zeros(size(Tick))
        self.shown = self.row.view(dtype(Tick))[0]  # the same memory, by name (as `remembered` is)
        self._remembered = np.zeros(size(Remembered))
        self.remembered = self._remembered.view(dtype(Remembered))[0]
        self._engaged = TAKE_OVER

    def tick(self, measured: Floats, setpoint: Floats) -> None:
        """Fly one tick; what it did is in `shown`."""
        tick(0.0, self._engaged, self._remembered, self.settings, setpoint, 0.0, measured, self.row)
        self._engaged = FLYING


@pytest.fixture(scope="session")
def ticks() -> type[Ticks]:
    return Ticks
