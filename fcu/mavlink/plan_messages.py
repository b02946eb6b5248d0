"""The mission protocol's messages: plans, fences and rally points, item by item, and back.

An item is kept as it came, so that a download gives back what was uploaded. What an item means for
the vehicle is not decided here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from fcu.mavlink.definitions import FENCE_MITIGATE_NONE, GLOBAL_FRAMES, MISSION_FRAME, Packed
from fcu.mavlink.definitions import message as _message
from fcu.mavlink.framing import Source

Fields = dict[str, Any]
UNSET = 2**31 - 1  # of a latitude or longitude: left out
_WHOLE = 1.0  # MAV_FRAME_MISSION: parameters 5 and 6 are plain numbers


class PlanItem(NamedTuple):
    """One item of a plan, a fence or the rally points, as MISSION_ITEM_INT carries it."""

    frame: int  # MAV_FRAME
    command: int  # MAV_CMD
    params: tuple[float, float, float, float]  # 1 to 4
    x: int  # latitude, degE7, in the global frames; parameter 5 in MAV_FRAME_MISSION
    y: int  # longitude, likewise
    z: float  # altitude, m, or parameter 7
    autocontinue: bool = True


class MissionMessage(NamedTuple):
    """One message of the mission protocol.

    `kind`: REQUEST_LIST, COUNT, CLEAR_ALL, REQUEST, REQUEST_INT, ITEM, ITEM_INT, SET_CURRENT,
    REQUEST_PARTIAL, WRITE_PARTIAL or ACK.
    """

    source: Source
    target_system: int
    target_component: int
    kind: str
    sequence: int = 0  # of the item it is about, from 0; of a part, the first
    total: int = 0  # of items announced; of a part, its last item
    mission_type: int = 0
    result: int = 0  # of an ACK: MAV_MISSION_RESULT
    item: PlanItem | None = None


def scale_of(frame: int) -> float:
    """The factor by which a latitude, length or number of MISSION_ITEM is multiplied by in MISSION_ITEM_INT."""
    if frame in GLOBAL_FRAMES:
        return 1e7
    return _WHOLE if frame == MISSION_FRAME else 1e4


def _whole(value: float, scale: float) -> int:
    if not math.isfinite(value):
        return UNSET
    return max(-UNSET - 1, min(UNSET, round(value * scale)))


def item_of(
    frame: int, command: int, params: tuple[float, ...], autocontinue: bool = True
) -> PlanItem:
    """The item of seven numbers, latitude and longitude in degrees. NaN: left out."""
    scale, (p1, p2, p3, p4, x, y, z) = scale_of(frame), params
    return PlanItem(
        frame, command, (p1, p2, p3, p4), _whole(x, scale), _whole(y, scale), z, autocontinue
    )


def _item(f: Fields, whole: bool) -> PlanItem:
    p1, p2, p3, p4 = (f[f"param{n}"] for n in range(1, 5))
    if not whole:
        seven = p1, p2, p3, p4, f["x"], f["y"], f["z"]
        return item_of(f["frame"], f["command"], seven, bool(f["autocontinue"]))
    auto = bool(f["autocontinue"])
    return PlanItem(f["frame"], f["command"], (p1, p2, p3, p4), f["x"], f["y"], f["z"], auto)


def _either(f: Fields, name: str, other: str) -> int:
    number: int = f[name] if name in f else f.get(other, 0)
    return number


def _read(kind: str) -> Callable[[Fields, Source], MissionMessage]:
    def read(f: Fields, source: Source) -> MissionMessage:
        first, last = _either(f, "seq", "start_index"), _either(f, "count", "end_index")
        item = _item(f, kind == "ITEM_INT") if kind in ("ITEM", "ITEM_INT") else None
        return MissionMessage(
            source, f["target_system"], f["target_component"], kind, first, last,
            f.get("mission_type", 0), f.get("type", 0), item,
        )  # fmt: skip

    return read


class MissionCurrent(NamedTuple):
    """MISSION_CURRENT: how far a plan is flown."""

    source: Source
    sequence: int
    total: int
    state: int  # MISSION_STATE


def _mission_current(f: Fields, source: Source) -> MissionCurrent:
    return MissionCurrent(source, f["seq"], f["total"], f["mission_state"])


Message = MissionMessage | MissionCurrent
READERS: dict[str, Callable[[Fields, Source], Message]] = {
    "MISSION_REQUEST_LIST": _read("REQUEST_LIST"),
    "MISSION_COUNT": _read("COUNT"),
    "MISSION_CLEAR_ALL": _read("CLEAR_ALL"),
    "MISSION_REQUEST": _read("REQUEST"),
    "MISSION_REQUEST_INT": _read("REQUEST_INT"),
    "MISSION_ITEM": _read("ITEM"),
    "MISSION_ITEM_INT": _read("ITEM_INT"),
    "MISSION_SET_CURRENT": _read("SET_CURRENT"),
    "MISSION_REQUEST_PARTIAL_LIST": _read("REQUEST_PARTIAL"),
    "MISSION_WRITE_PARTIAL_LIST": _read("WRITE_PARTIAL"),
    "MISSION_ACK": _read("ACK"),
    "MISSION_CURRENT": _mission_current,
}


# --- built


def _to(to: Source) -> dict[str, int]:
    return {"target_system": to.system, "target_component": to.component}


def count(total: int, kind: int, to: Source, identity: int = 0) -> Packed:
    """MISSION_COUNT. `identity`: of what is stored, 0 for nothing."""
    return _message("MISSION_COUNT", count=total, mission_type=kind, opaque_id=identity, **_to(to))


def ack(result: int, kind: int, to: Source, identity: int = 0) -> Packed:
    """MISSION_ACK. `identity`: as of `count`."""
    return _message("MISSION_ACK", type=result, mission_type=kind, opaque_id=identity, **_to(to))


def request_list(kind: int, to: Source) -> Packed:
    """MISSION_REQUEST_LIST."""
    return _message("MISSION_REQUEST_LIST", mission_type=kind, **_to(to))


def request(sequence: int, kind: int, to: Source, whole: bool) -> Packed:
    """MISSION_REQUEST_INT, or the older MISSION_REQUEST."""
    name = "MISSION_REQUEST_INT" if whole else "MISSION_REQUEST"
    return _message(name, seq=sequence, mission_type=kind, **_to(to))


def item(
    each: PlanItem, sequence: int, kind: int, to: Source, whole: bool, current: bool
) -> Packed:
    """MISSION_ITEM_INT, or the older MISSION_ITEM with its floats."""
    x: float = each.x
    y: float = each.y
    if not whole:
        scale = scale_of(each.frame)
        x, y = (math.nan if n == UNSET else n / scale for n in (each.x, each.y))
    p1, p2, p3, p4 = each.params
    return _message(
        "MISSION_ITEM_INT" if whole else "MISSION_ITEM", seq=sequence, frame=each.frame,
        command=each.command, current=current, autocontinue=each.autocontinue, param1=p1, param2=p2,
        param3=p3, param4=p4, x=x, y=y, z=each.z, mission_type=kind, **_to(to),
    )  # fmt: skip


def current(
    sequence: int, total: int, state: int, active: bool, identities: tuple[int, int, int]
) -> Packed:
    """MISSION_CURRENT. `active`: the vehicle is in mode Mission. `identities`: plan, fence, rally."""
    mission_id, fence_id, rally_points_id = identities
    return _message(
        "MISSION_CURRENT", seq=sequence, total=total, mission_state=state,
        mission_mode=1 if active else 2, mission_id=mission_id, fence_id=fence_id,
        rally_points_id=rally_points_id,
    )  # fmt: skip


def reached(sequence: int) -> Packed:
    """MISSION_ITEM_REACHED."""
    return _message("MISSION_ITEM_REACHED", seq=sequence)


def fence_status(breached: bool, times: int, kind: int, since_ms: int) -> Packed:
    """FENCE_STATUS."""
    return _message(
        "FENCE_STATUS", breach_status=breached, breach_count=times, breach_type=kind,
        breach_time=since_ms, breach_mitigation=FENCE_MITIGATE_NONE,
    )  # fmt: skip
