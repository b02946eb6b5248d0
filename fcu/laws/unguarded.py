"""The guard of a law that has none: it changes nothing, remembers nothing, tells nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from fcu.interface.messages import Setpoint
from fcu.interface.parameter import Parameter, Value
from fcu.kernel.compile import kernel

# Every guard has these names.
NAMES = (
    "GuardParams", "GuardState", "GuardInternals", "take_over", "before", "after", "idle",
    "PARAMETERS", "printed", "guard_params", "followed", "derived", "check",
)  # fmt: skip


class GuardParams(NamedTuple):
    """Nothing."""


class GuardState(NamedTuple):
    """Nothing."""


class GuardInternals(NamedTuple):
    """Nothing."""


class Governed(NamedTuple):
    """The setpoint that the law is given: the one asked for."""

    setpoint: Setpoint


@kernel
def take_over(params, law, setpoint, measured):
    """As `before`."""
    return Governed(setpoint=setpoint)


@kernel
def before(state, params, law, law_state, setpoint, measured):
    """The Governed of a tick."""
    return Governed(setpoint=setpoint)


@kernel
def after(governed, params, law, law_state, outputs, internals, measured):
    """Nothing, twice."""
    return GuardState(), GuardInternals()


@kernel
def idle(measured):
    """Nothing, twice."""
    return GuardState(), GuardInternals()


# --- its parameters: none

PARAMETERS: tuple[Parameter, ...] = ()


def printed(chosen: Mapping[str, Any]) -> Mapping[str, Value]:
    """No defaults."""
    return {}


def guard_params(
    airframe: Mapping[str, Any], law: Any, chosen: Mapping[str, Any] | None = None
) -> GuardParams:
    """Nothing."""
    return GuardParams()


def followed(params: GuardParams, before: Any, law: Any) -> GuardParams:
    """Nothing."""
    return params


def derived(params: GuardParams, law: Any) -> GuardParams:
    """Nothing."""
    return params


def check(params: GuardParams, law: Any) -> None:
    """Nothing can be wrong."""
