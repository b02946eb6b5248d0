"""What is said of commands, when there are thousands of them."""

from __future__ import annotations

from fcu.interface.status_texts import Code, Told
from fcu.services.text_budget import (
    ALL_AT_ONCE,
    ALL_PER_S,
    CLASS_AT_ONCE,
    CLASS_PER_S,
    TextBudget,
    class_of,
)

SECONDS = 5
HOLD, HOME, ARMED = Told(Code.MODE, ("Hold",)), Told(Code.HOME_SET), Told(Code.ARMED)


def said(budget, tolds, good=True, per_s=4600):
    """How many of a flood of these, taken in turns, are said in SECONDS."""
    n = SECONDS * per_s
    return sum(budget.may_say(tolds[k % len(tolds)], good, 100.0 + k / per_s) for k in range(n))


def test_of_what_succeeds_thousands_of_times_some_is_said():
    budget = TextBudget()
    heard = said(budget, [HOLD])
    assert CLASS_AT_ONCE <= heard <= CLASS_AT_ONCE + SECONDS * CLASS_PER_S + 1
    assert budget.unsaid == SECONDS * 4600 - heard


def test_names_and_numbers_make_no_other_class():
    budget = TextBudget()
    modes = [Told(Code.MODE, (f"{n}",)) for n in range(1000)]
    assert said(budget, modes) <= CLASS_AT_ONCE + SECONDS * CLASS_PER_S + 1


def test_all_classes_together_have_a_limit_too():
    budget = TextBudget()
    whys = [Told(Code.DENIED, ("Mode", Told(code))) for code in Code]
    assert said(budget, whys, good=False) <= ALL_AT_ONCE + SECONDS * ALL_PER_S + 1


def test_a_class_that_comes_in_a_flood_silences_no_other():
    budget = TextBudget()
    said(budget, [HOLD])
    assert budget.may_say(ARMED, True, 100.0 + SECONDS)
    assert budget.may_say(Told(Code.DENIED, ("Arming", Told(Code.NO_STATE))), False, 105.0)


def test_a_refusal_is_of_the_class_of_its_reason():
    mode, home = (Told(Code.DENIED, (what, Told(Code.NO_STATE))) for what in ("Mode", "Home"))
    assert class_of(mode) == class_of(home) == (Code.DENIED, Code.NO_STATE)
    assert class_of(mode) != class_of(Told(Code.DENIED, ("Mode", Told(Code.NOT_ARMED))))
