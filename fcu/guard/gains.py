"""Gains that a vehicle refuses, whoever asks for them: the one place that decides, by `stability`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fcu.guard import stability
from fcu.kernel.buffers import fields
from fcu.laws.loader import Law
from fcu.laws.mmrac.types import Params

FLY, REFUSE = UNSTABLE_GAINS = ("fly", "refuse")  # values of unstable_gains
RULE = (
    " (the loop has to be stable in hover, estimates right or 3 dB off:"
    ' fcu/guard/README.md, "Which gains go together")'
)


def has_rule(law: Law) -> bool:
    """Return True for a law whose gains the rule of stability judges: one with the paper's Params."""
    return fields(law.settings.Settings)["law"] is Params


def unstable(law: Law, settings: Any) -> str:
    """The channel for which a vehicle refuses the gains of these Settings. Empty if it flies them."""
    return stability.unstable(settings.law, settings.guard) if has_rule(law) else ""


def deciding(law: Law, channel: str) -> tuple[str, ...]:
    """Keys of the parameters that decide whether a channel is stable, the most important first."""
    keys = {part.name: row.key for row in law.settings.PARAMETERS for part in row.parts}
    found = [keys[name] for name in stability.DECIDES[channel] if keys[name]]
    return tuple(dict.fromkeys([*found, "rotor_response_s", "allocation"]))


def why_refused(law: Law, channel: str, chosen: Mapping[str, str]) -> str:
    """A sentence about gains that a vehicle refuses.

    channel : as `unstable` returns it.  chosen : key -> value and origin, of the parameters that are not at
    their defaults, in the order in which they are reported.
    """
    known = deciding(law, channel)
    said = ", ".join(f"{key} = {value}" for key, value in chosen.items() if key in known)
    return (
        f"a vehicle refuses these gains: {channel} unstable{f' with {said}' if said else ''}{RULE}"
    )
