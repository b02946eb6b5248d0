"""How much is said of what ground stations ask for: limited by class, whether it succeeds or not.

A client that sends thousands of commands a second has an acknowledgement for each. In words, to
everybody and into the log, only a few of each class are told, and a few of all: the link has
telemetry to carry.
"""

from __future__ import annotations

from fcu.interface.status_texts import Code, Told
from fcu.services.ground_port import Bucket

CLASS_PER_S, CLASS_AT_ONCE = 2.0, 20.0  # texts of one class, wall
ALL_PER_S, ALL_AT_ONCE = 10.0, 50.0  # of all classes that succeed; and of all that are refused

Class = tuple[Code, ...]


class TextBudget:
    """What may still be said."""

    def __init__(self) -> None:
        self.unsaid = 0  # texts that were left out
        self._of_class: dict[Class, Bucket] = {}
        self._of_all = {good: Bucket(ALL_PER_S, ALL_AT_ONCE) for good in (True, False)}

    def may_say(self, told: Told, good: bool, now: float) -> bool:
        """Whether there is room for one more. `good`: it tells of what was done. `now`: wall, s."""
        kind = class_of(told)
        if kind not in self._of_class:
            self._of_class[kind] = Bucket(CLASS_PER_S, CLASS_AT_ONCE)
        if self._of_class[kind].take(now) and self._of_all[good].take(now):
            return True
        self.unsaid += 1
        return False


def class_of(told: Told) -> Class:
    """What texts share that differ in names and numbers: their codes, of which there are few."""
    inner = (value for value in told.values if isinstance(value, Told))
    return told.code, *(code for each in inner for code in class_of(each))
