"""The publisher of a flight, as a child of whoever flies it: started, never depended on."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fcu.interface import publisher_feed, topics
from gcs_tools.flight.processes import Child, InfrastructureError

READY_S = 20.0  # wall: after that the flight begins without it, though it may still work


@dataclass(frozen=True)
class Zenoh:
    """How a flight is published."""

    config: Path | None = None  # Zenoh's own; None: loopback, without a router


class PublisherProcess:
    """One publisher. What becomes of it never ends a flight."""

    def __init__(
        self, how: Zenoh, folder: Path, instance: int, law: str, flies: dict[str, Any],
        lifeline: int,
    ) -> None:  # fmt: skip
        """`law`: its name or file.  `flies`: what a vehicle's `about` tells.

        `lifeline`: inherited, and closed on our side.
        """
        self.run = topics.run_name(folder.absolute().name)
        about = folder / "about.json"
        about.write_text(json.dumps(flies, indent=1))
        config = ["--zenoh", str(how.config)] if how.config else []
        self._child = Child(
            "publisher", "gcs_tools",
            ["publish", "--instance", str(instance), "--law", law, "--run", self.run,
             "--about", str(about), "--lifeline-fd", str(lifeline), *config],
            folder / "publisher.log", (lifeline,), forks=True, tells=True,
        )  # fmt: skip
        self.pid = self._child.process.pid
        self._publishes = False

    def wait_ready(self) -> str:
        """Until it publishes; why it does not, or ""."""
        if not publisher_feed.SUPPORTED:
            return "diagnostics are published on Linux alone"
        until = time.monotonic() + READY_S

        def check() -> None:
            self._child.check()
            if time.monotonic() > until:
                raise InfrastructureError(f"the publisher was not ready within {READY_S:.0f} s")

        try:
            self._child.wait_ready(check)
        except InfrastructureError as error:
            said = self._child.last_error()
            return str(error) if said is None else said.text
        self._publishes = True
        return ""

    def keep_off(self, core: int) -> None:
        """Leave a core to those who take turns on it."""
        if hasattr(os, "sched_setaffinity"):
            others = os.sched_getaffinity(0) - {core}
            try:
                os.sched_setaffinity(self.pid, others or {core})
            except OSError:
                pass  # it has ended

    def has_died(self) -> bool:
        """Whether it has ended though it was not told to; says so once."""
        died = self._publishes and bool(self._ended_early())
        self._publishes = self._publishes and not died
        return died

    def stop(self) -> dict[str, Any]:
        """End it, after those who feed it; what it said last, and under "problem" what went wrong."""
        problem = self._ended_early()
        said = self._child.stop()
        if self._publishes and not said and not problem:
            problem = "the publisher did not end when it was told to"
        self._publishes = False
        lost = {who: n for who, n in said.get("lost", {}).items() if n}
        if lost:
            problem = ", ".join(f"{n} ticks of the {who}" for who, n in lost.items())
            problem += " came too fast to be published"
        return said | {"problem": problem}

    def _ended_early(self) -> str:
        try:
            self._child.check()
        except InfrastructureError as error:
            return f"{error}, before the flight had ended" if self._publishes else ""
        return ""
