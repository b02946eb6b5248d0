"""The law as it is flown, and random systems of the general form, a batch at a time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import fcu
from fcu.interface.airframe import airframe, load
from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.rotations import from_euler
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.parameters import law_params
from fcu.laws.mmrac.types import Bounds, Params, State
from tests.laws.conftest import PAPER
from tests.theory.instants import States

OCTO = load(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
ZERO = Vec3(0.0, 0.0, 0.0)
# -1e6 to 1e6, which no estimate of a test meets: as printed for the estimate itself, and by the
# achieved force for its inverse
PRINTED = Bounds(-1e6, 1e6, -1e6, 1e6, 1e6, 1e6, 1e6)
ACHIEVED = Bounds(1e-6, -1e-6, 1e-6, -1e-6, 1e6, 1e6, 1e6)


@pytest.fixture(scope="session")
def law() -> Callable[..., Params]:
    """Params of the octocopter: `law(f_m=1.4)`, `law(rate_hz=250.0, prediction="demanded")`."""
    believed = airframe(OCTO["rotors"], "s1000.toml")

    def build(rate_hz: float = 500.0, **chosen: Any) -> Params:
        return law_params(
            believed, OCTO, rate_hz, chosen if "prediction" in chosen else {**PAPER, **chosen}
        )

    return build


@pytest.fixture(scope="session")
def free(law: Callable[..., Params]) -> Callable[..., Params]:
    """Params whose sets of projection are out of the way, gains all different."""

    def build(rate_hz: float = 500.0, **chosen: Any) -> Params:
        gains = {
            "gamma": 900.0, "gamma_m": 0.7, "gamma_Lambda": 6e-4, "gamma_J": 0.9,
            "gamma_LambdaJ": 1.1, "gamma_c": 0.8,
        }  # fmt: skip
        params = law(rate_hz, **{**gains, **chosen})
        sets = ACHIEVED if params.achieved > 0.5 else PRINTED
        return params._replace(lambda_v=31.0, lambda_w=29.0, bounds=sets)

    return build


@pytest.fixture(scope="session")
def taken_over() -> Callable[[Params], State]:
    """The state of a law that has just taken over at rest; tests replace its fields."""

    def build(params: Params) -> State:
        at_rest = VehicleState(ZERO, ZERO, from_euler(0.0, 0.0, 0.0), ZERO, Rotors(*[345.0] * 8))
        return mmrac.beginning(params, at_rest)

    return build


@pytest.fixture(scope="session")
def some() -> States:
    """1000 random instants, the same for every test."""
    return States(7)
