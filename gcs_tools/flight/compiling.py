"""Progress of the compiling before a first flight, for a person who waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from fcu.kernel import cache
from fcu.kernel.compile import kept

# kernels done, of about how many, and for how long so far (wall, s)
Compiled = Callable[[int, int, float], None]

ABOUT = 400  # kernels of a flight of M-MRAC with its guard; other laws have fewer
LOOK_S = 0.25  # wall: between two looks


class Compiling:
    """Counts the kernels that all processes of a flight have compiled since this was made."""

    def __init__(self, package: str, tell: Compiled) -> None:
        """`package`: of the law. `tell`: told at each look at which one more is there."""
        self._package, self._tell = package.partition(".")[0], tell
        self._before = kept(self._package)
        self._began_s = time.monotonic()
        self._looked_s = 0.0
        self._told = 0

    def look(self) -> None:
        """Tell how far it has come, unless it was told just now or nothing more was compiled."""
        now = time.monotonic()
        if now - self._looked_s < LOOK_S:
            return
        self._looked_s = now
        if (done := kept(self._package) - self._before) > self._told:
            self._told = done
            self._tell(done, max(ABOUT, done), now - self._began_s)

    @contextmanager
    def here(self) -> Iterator[None]:
        """Look whenever a kernel was compiled by this process, while the body runs."""
        cache.watchers.append(self.look)
        try:
            yield
        finally:
            cache.watchers.remove(self.look)
