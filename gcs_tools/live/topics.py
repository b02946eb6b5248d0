"""What is on the bus, as a list: `gcs topics`."""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fcu.interface import topics as keys
from gcs_tools.live.subscriber import LOOK_S, Counted, Subscriber
from gcs_tools.recording import events

MOST = 1000  # columns of a table that is piped


def listen(vehicle: Subscriber, seconds: float) -> dict[str, Any]:
    """What comes of each topic in so many seconds (wall); its rate is seen in that time."""
    assert vehicle.key is not None
    before = {topic: int(sample.sequence[-1]) for topic, sample in vehicle.latest()}
    began = time.monotonic()
    while (past := time.monotonic() - began) < seconds:
        for _ in vehicle.take():
            pass
        time.sleep(LOOK_S)
    encodings = {name: topic.encoding for name, topic in vehicle.topics.items()}
    encodings[events.TOPIC] = events.encoding()
    within = f"{keys.namespace(vehicle.key.run)}/{vehicle.key.vehicle}"
    return {
        "schema": 1,
        "run": vehicle.key.run,
        "vehicle": vehicle.key.vehicle,
        "alive": sorted(vehicle.alive),
        "mission": vehicle.about.get("mission"),
        "seconds": past,
        "topics": {
            topic: _one(f"{within}{topic}", encodings.get(topic, ""), vehicle.counted.get(topic),
                        before.get(topic), past)
            for topic in sorted({*encodings, *vehicle.counted})
        },
    }  # fmt: skip


def _one(
    key: str, encoding: str, counted: Counted | None, last: int | None, seconds: float
) -> dict[str, Any]:
    c = counted or Counted()
    return {
        "key": key,
        "message": (c.encoding or encoding).partition(";")[2],
        "ticks": c.ticks,
        "rate_hz": c.ticks / seconds,
        "samples_hz": c.samples / seconds,
        "bytes_s": c.bytes / seconds,
        "tick_bytes": c.bytes / c.ticks if c.ticks else None,
        "lost": c.lost,
        "unreadable": c.unreadable,
        "last_sequence": c.last if c.last >= 0 else last,
    }


def print_table(found: dict[str, Any]) -> None:
    """Print it as a table."""
    console = Console(highlight=False)
    mission = f", {found['mission']}" if found["mission"] else ""
    there = ", ".join(found["alive"]) or "nobody"
    console.print(
        Text.assemble(
            (f"vehicle {found['vehicle']}", "bold"),
            f" of run {found['run']}{mission}; there: {there}",
        )
    )
    within = f"{keys.namespace(found['run'])}/{found['vehicle']}/"
    console.print(Text(f"keys below {within}", style="dim"))
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for name in ("key", "message"):
        table.add_column(name, overflow="fold")  # where there is no room, over lines: never cut
    for name in ("ticks/s", "samples/s", "kB/s", "B/tick", "lost", "last"):
        table.add_column(name, justify="right", overflow="fold")
    for topic in found["topics"].values():
        idle = not topic["ticks"]
        lost = topic["lost"] + topic["unreadable"]
        table.add_row(
            topic["key"].removeprefix(within),
            topic["message"].rpartition(".")[2],
            "-" if idle else f"{topic['rate_hz']:.1f}",
            "-" if idle else f"{topic['samples_hz']:.1f}",
            "-" if idle else f"{topic['bytes_s'] / 1e3:.1f}",
            "-" if idle else f"{topic['tick_bytes']:.0f}",
            Text(str(lost), style="bold red" if lost else ""),
            "-" if topic["last_sequence"] is None else str(topic["last_sequence"]),
            style="dim" if idle else "",
        )
    if not console.is_terminal:
        room = console.options.update(width=MOST)
        console.width = max(console.width, console.measure(table, options=room).maximum)
    console.print(table)
