"""The faults that a mission orders: told in the verdict, and each is to begin before the flight ends."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_tools.judging.expectations import FAULTS, Expectation
from gcs_tools.missions.tables import PlantFault
from gcs_tools.recording.table import HALF_US

_SHOWN = 3  # faults that the verdict names


def in_words(fault: PlantFault) -> str:
    """A fault in a few words: what, of which rotor, when and for how long."""
    of = "" if fault.rotor is None else f" of rotor {fault.rotor}"
    lasts = "" if fault.for_s is None else f" for {fault.for_s:g} s"
    return f"{fault.kind}{of} at {fault.at_s:g} s{lasts}"


def judge_faults(faults: Sequence[PlantFault], last_s: float) -> list[Expectation]:
    """Judge the faults of a flight whose last tick was at a simulation time (s). None: nothing is judged."""
    if not faults:
        return []
    late = [each for each in faults if each.at_s > last_s + HALF_US]
    shown = ", ".join(map(in_words, faults[:_SHOWN]))
    shown += f" and {len(faults) - _SHOWN} more" if len(faults) > _SHOWN else ""
    why = None
    if late:
        which = ", ".join(map(in_words, late[:_SHOWN]))
        why = (
            f"the flight ended at {last_s:.3f} s, before {which}: let the fault come sooner, or the"
            " flight last longer"
        )
    n = len(faults) - len(late)
    value = "all began" if not late else f"{n} of {len(faults)} began"
    return [Expectation(FAULTS, "all began", value, not late, f"{FAULTS}: {shown}", why)]
