"""MAVROS' mission protocol: what its waypoint, geofence and rallypoint plugins send, wait for and give up.

Source: MissionBase in mavros/src/plugins/mission_protocol_base.cpp of mavlink/mavros at f8f462dd, by the names that
states and constants have there. The vehicle tells the capability MISSION_INT, so items go and come as MISSION_ITEM_INT.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import message_types as ros

WP_TIMEOUT_S, LIST_TIMEOUT_S, RETRIES_COUNT = 1.0, 30.0, 3
WAYPOINTS, GEOFENCE, RALLYPOINTS = 0, 1, 2  # MAV_MISSION_TYPE
ACCEPTED, INVALID_SEQUENCE = 0, 13  # MAV_MISSION_RESULT
IDLE, RXLIST, RXWPINT, TXLIST, TXWPINT, CLEAR, SET_CUR = (
    "IDLE", "RXLIST", "RXWPINT", "TXLIST", "TXWPINT", "CLEAR", "SET_CUR",
)  # fmt: skip
UPLOADS = (TXLIST, TXWPINT)
WHOLE = 1e7  # encode_factor of the global frames


class MissionPlugin:
    """One of the three plugins."""

    def __init__(
        self, send: Callable[[str, tuple[Any, ...]], None], kind: int, tell: Callable[[Any], None]
    ) -> None:
        """`send`: a message by its name in pymavlink, with the fields behind the target. `tell`: the list of waypoints."""
        self._send, self._kind, self._tell = send, kind, tell
        self._came = threading.Condition(threading.RLock())
        self._state = IDLE
        self._waypoints: list[Any] = []
        self._sends: list[Any] = []
        self._count = self._at = self._set = self._retries = 0
        self._failed = False
        self._timer: threading.Timer | None = None
        self._active = 0

    # ---- services

    def pull(self) -> dict[str, Any]:
        """Get what the vehicle has."""
        done = self._do(RXLIST, 0, lambda: self._list())
        return {"success": done, "wp_received": len(self._waypoints)}

    def push(self, asked: Any) -> dict[str, Any]:
        """Send a whole list. A part of one is for ArduPilot alone."""
        if asked.start_index:
            return {"success": False, "wp_transfered": 0}
        self._sends, self._at = list(asked.waypoints), 0
        done = self._do(TXLIST, len(self._sends), self._announce)
        return {"success": done, "wp_transfered": self._at + 1}

    def clear(self) -> dict[str, Any]:
        """Clear it on the vehicle."""
        return {"success": self._do(CLEAR, 0, lambda: self._send("mission_clear_all", (self._kind,)))}  # fmt: skip

    def set_current(self, seq: int) -> dict[str, Any]:
        """Set the item that is the next."""
        self._set = seq
        return {"success": self._do(SET_CUR, 0, lambda: self._send("mission_set_current", (seq,)))}

    def _do(self, state: str, count: int, begin: Callable[[], None]) -> bool:
        with self._came:
            if self._state != IDLE:
                return False
            self._state, self._count, self._failed = state, count, False
            self._restart(RETRIES_COUNT)
            begin()
            ended = self._came.wait_for(lambda: self._state == IDLE, LIST_TIMEOUT_S)
            self._idle()
            return ended and not self._failed

    # ---- what the vehicle says

    def hears(self, m: Any) -> None:
        """One message of the mission protocol."""
        call = getattr(self, "_" + m.get_type().lower(), None)
        with self._came:
            if call is not None and getattr(m, "mission_type", self._kind) == self._kind:
                call(m)

    def _mission_count(self, m: Any) -> None:
        if self._state != RXLIST:
            return
        self._count, self._at, self._waypoints = m.count, 0, []
        if m.count:
            self._state = RXWPINT
            self._restart(RETRIES_COUNT)
            self._send("mission_request_int", (0, self._kind))
        else:
            self._received()

    def _mission_item_int(self, m: Any) -> None:
        if self._state != RXWPINT or m.seq not in (self._at, self._at + 1):
            return
        self._waypoints.append(
            ros.Waypoint(
                frame=m.frame, command=m.command, is_current=bool(m.current), autocontinue=bool(m.autocontinue),
                param1=m.param1, param2=m.param2, param3=m.param3, param4=m.param4, x_lat=m.x / WHOLE,
                y_long=m.y / WHOLE, z_alt=m.z,
            )
        )  # fmt: skip
        self._at += 1
        if self._at < self._count:
            self._restart(RETRIES_COUNT)
            self._send("mission_request_int", (self._at, self._kind))
        else:
            self._received()

    def _received(self) -> None:
        self._send("mission_ack", (ACCEPTED, self._kind))
        self._idle()
        self._publish()

    def _mission_request(self, m: Any) -> None:
        begins = self._state == TXLIST and m.seq == 0
        if not (begins or self._state == TXWPINT) or m.seq not in (self._at, self._at + 1):
            return
        self._restart(RETRIES_COUNT)
        if m.seq < self._count:
            self._state, self._at = TXWPINT, m.seq
            self._item(m.seq)

    _mission_request_int = _mission_request

    def _mission_ack(self, m: Any) -> None:
        if self._state in UPLOADS and self._at == self._count - 1 and m.type == ACCEPTED:
            self._waypoints, self._sends = self._sends, []
            self._idle()
            self._publish()
        elif self._state == TXWPINT and m.type == INVALID_SEQUENCE:
            pass  # the request for the next item is lost, and comes again
        elif self._state in UPLOADS:
            self._fail()
        elif self._state == CLEAR:
            if m.type != ACCEPTED:
                self._failed = True
            else:
                self._waypoints = []
            self._idle()
            self._publish()

    def _mission_current(self, m: Any) -> None:
        if self._kind == WAYPOINTS and self._state in (SET_CUR, IDLE):
            changed, self._active = self._active != m.seq, m.seq
            if self._state == SET_CUR:
                self._idle()
            if changed:
                self._publish()

    # ---- the rest

    def _announce(self) -> None:
        self._send("mission_count", (self._count, self._kind))

    def _list(self) -> None:
        self._send("mission_request_list", (self._kind,))

    def _item(self, n: int) -> None:
        w = self._sends[n]
        self._send(
            "mission_item_int",
            (n, w.frame, w.command, w.is_current, w.autocontinue, w.param1, w.param2, w.param3, w.param4,
             int(w.x_lat * WHOLE), int(w.y_long * WHOLE), w.z_alt, self._kind),
        )  # fmt: skip

    def _restart(self, retries: int) -> None:
        self._retries = retries
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(WP_TIMEOUT_S, self._late)
        self._timer.daemon = True
        self._timer.start()

    def _late(self) -> None:
        """Ask again, or give up."""
        with self._came:
            if self._state == IDLE:
                return
            if self._retries <= 0:
                self._fail()
                return
            {
                RXLIST: self._list, RXWPINT: lambda: self._send("mission_request", (self._at, self._kind)),
                TXLIST: self._announce, TXWPINT: lambda: self._item(self._at),
                CLEAR: lambda: self._send("mission_clear_all", (self._kind,)),
                SET_CUR: lambda: self._send("mission_set_current", (self._set,)),
            }[self._state]()  # fmt: skip
            self._restart(self._retries - 1)

    def _fail(self) -> None:
        self._failed = True
        self._idle()

    def _idle(self) -> None:
        self._state = IDLE
        if self._timer is not None:
            self._timer.cancel()
        self._came.notify_all()

    def _publish(self) -> None:
        self._tell(ros.WaypointList(self._active, list(self._waypoints)))
