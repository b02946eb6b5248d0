"""Suggestions for a word that is none of those that are known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

MOST = 20  # words of a list that a message names


def closest(word: Any, known: Iterable[str]) -> str | None:
    """The known word that `word` was probably meant to be. None: none is close."""
    return next(iter(difflib.get_close_matches(str(word), list(known), n=1)), None)


def suggestion(word: Any, known: Iterable[str]) -> str:
    """` (did you mean WORD?)`, to stand after the unknown word. Empty: no known word is close."""
    close = closest(word, known)
    return "" if close is None else f" (did you mean {close}?)"


def suggestion_or_list(word: Any, known: Iterable[str], most: int = MOST) -> str:
    """The suggestion. Where no word is close, the list of those that are known, unless more than `most`."""
    words = list(known)
    listed = f"; there are {', '.join(words)}" if len(words) <= most else ""
    return suggestion(word, words) or listed
