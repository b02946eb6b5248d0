"""The mission protocol: plans, fences and rally points taken from a client and given to it.

What is stored is replaced whole, once the last item has come and the whole is accepted. Until then
the vehicle has what it had. One client uploads at a time, any number download, each from what was
stored when it asked for the list. An item that was asked for and does not come is asked for again.
A client that stays silent has broken its upload off. Requests alternate between MISSION_REQUEST_INT
and the older MISSION_REQUEST until the client has answered one of them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol
from zlib import crc32

from fcu.interface.status_texts import Code, Told
from fcu.mavlink import plan_messages
from fcu.mavlink.definitions import MissionResult, MissionState, MissionType, Packed
from fcu.mavlink.plan_messages import MissionMessage, PlanItem
from fcu.services.ground_port import GroundPort, Link
from fcu.services.plan_items import MOST_ITEMS, NAMES, RefusedItem
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine

AGAIN_S = 0.25  # wall: an item that was asked for and has not come is asked for again, as by PX4
SILENT_S = 5.0  # wall: a client that stays silent for so long has broken off
REMEMBERED_S = 5.0  # wall: for so long the answer to a last item is given again
KINDS = MissionType.MISSION, MissionType.FENCE, MissionType.RALLY

Items = tuple[PlanItem, ...]
Tell = Callable[[Told, bool], None]  # what is told, and whether it is good


Taking = Generator[None, int, Told | None]
"""Work on what was uploaded: sent the simulation time, us, for each part of it. Returns what is told."""


class Takes(Protocol):
    """Takes a whole plan, fence or rally points."""

    def __call__(self, kind: MissionType, items: Items) -> Taking:
        """Take them, a part of the work at a time. Raises RefusedItem, with nothing changed."""


@dataclass
class Upload:
    """Items on their way in."""

    port: GroundPort
    link: Link
    message: MissionMessage  # that has begun it
    kind: MissionType
    items: list[PlanItem]  # those there were, of a part; then as they come
    first: int  # the item asked for first
    end: int  # behind the last
    next: int  # the item asked for now
    asked_at: float  # wall, s
    heard_at: float
    whole: bool | None = None  # the client sends MISSION_ITEM_INT; None: not known yet
    tries: int = 0
    taking: Taking | None = None  # all items are here, and are looked at


@dataclass
class Ended:
    """The last upload of a client, in case its last item is sent again."""

    link: Link
    kind: MissionType
    last: int
    result: MissionResult
    at: float


@dataclass
class Stored:
    """All that the vehicle has, of each kind."""

    items: dict[MissionType, Items] = field(default_factory=lambda: dict.fromkeys(KINDS, ()))
    _identities: dict[MissionType, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))

    def replace(self, kind: MissionType, items: Items) -> None:
        """Put items in the place of those there were."""
        self.items[kind], self._identities[kind] = items, _identity_of(items)

    def identity(self, kind: MissionType) -> int:
        """A number that is another for other items, and 0 without items."""
        return self._identities[kind]


class PlanProtocol:
    """One for all links."""

    def __init__(self, vehicle: StateMachine, takes: Takes, tell: Tell) -> None:
        self.stored = Stored()
        self._vehicle, self._takes, self._tell = vehicle, takes, tell
        self._upload: Upload | None = None
        self._ended: Ended | None = None

    def take(
        self, port: GroundPort, link: Link, message: MissionMessage, t_us: int, now: float
    ) -> None:
        """One message of a client. `now`: wall, s."""
        kind, to = message.mission_type, message.source
        if kind not in (*KINDS, MissionType.ALL) or (
            kind == MissionType.ALL and message.kind != "CLEAR_ALL"
        ):
            if message.kind != "ACK":
                port.send(link, plan_messages.ack(MissionResult.UNSUPPORTED, kind, to))
            return
        if message.kind in ("ITEM", "ITEM_INT"):
            self._item(port, link, message, t_us, now)
        elif message.kind == "COUNT":
            self._count(port, link, message, t_us, now)
        elif message.kind == "WRITE_PARTIAL":
            self._part(port, link, message, now)
        elif message.kind == "REQUEST_LIST":
            link.downloads[kind] = self.stored.items[MissionType(kind)]
            total, identity = len(link.downloads[kind]), self.stored.identity(MissionType(kind))
            port.send(link, plan_messages.count(total, kind, to, identity))
        elif message.kind == "REQUEST_PARTIAL":
            link.downloads[kind] = self.stored.items[MissionType(kind)]
            port.send(link, plan_messages.count(len(link.downloads[kind]), kind, to))
        elif message.kind in ("REQUEST", "REQUEST_INT"):
            self._give(port, link, message)
        elif message.kind == "CLEAR_ALL":
            self._clear(port, link, message, t_us, now)
        elif message.kind == "SET_CURRENT":
            answer = self._vehicle.set_current(message.sequence, t_us)
            if answer.told is not None:
                self._tell(answer.told, answer.granted)
            if not answer.granted:
                port.send(link, plan_messages.ack(MissionResult.INVALID_SEQUENCE, kind, to))
        elif message.kind == "ACK":
            self._acknowledged(link, message, now)

    def pace(self, now: float) -> None:
        """Ask again for what has not come. Break off what nobody goes on with."""
        upload = self._upload
        if upload is None or upload.taking is not None:
            return
        if now - upload.heard_at >= SILENT_S:
            self._finish(upload, MissionResult.CANCELLED, Told(Code.TRANSFER_LOST), now)
        elif now - upload.asked_at >= AGAIN_S:
            upload.tries += 1
            self._ask(upload, now)

    def look_on(self, t_us: int, now: float) -> None:
        """Go on with the look at what was uploaded, if there is one. `now`: wall, s."""
        upload = self._upload
        if upload is None or upload.taking is None:
            return
        items = tuple(upload.items)
        try:
            upload.taking.send(t_us)
        except StopIteration as done:
            self.stored.replace(upload.kind, items)
            self._finish(upload, MissionResult.ACCEPTED, done.value, now)
        except RefusedItem as refused:
            self._finish(upload, refused.result, refused.told, now)

    # --- in

    def _count(
        self, port: GroundPort, link: Link, message: MissionMessage, t_us: int, now: float
    ) -> None:
        kind, upload = MissionType(message.mission_type), self._others(link)
        if upload is not None and upload.link is not link:
            self._refuse(port, link, message, MissionResult.ERROR, Told(Code.TRANSFER_BUSY))
            return
        if upload is not None and upload.next == 0 and _same(upload.message, message):
            upload.heard_at = now
            self._ask(upload, now)  # the request was lost
            return
        self._leave(kind, now)
        if message.total > MOST_ITEMS:
            why = Told(Code.ITEMS_TOO_MANY, (message.total, MOST_ITEMS))
            self._refuse(port, link, message, MissionResult.NO_SPACE, why)
            return
        begun = Upload(port, link, message, kind, [], 0, message.total, 0, now, now)
        if message.total == 0:
            self._whole(begun, t_us, now)
            return
        self._upload = begun
        self._ask(begun, now)

    def _others(self, link: Link) -> Upload | None:
        """The upload in progress. One whose client has gone is broken off for another."""
        upload = self._upload
        if upload is not None and upload.link is not link:
            gone = all(upload.link is not each for each in upload.port.everyone())
            self._upload = None if gone else upload
        return self._upload

    def _part(self, port: GroundPort, link: Link, message: MissionMessage, now: float) -> None:
        kind, first, last = MissionType(message.mission_type), message.sequence, message.total
        items = self.stored.items[kind]
        upload = self._others(link)
        if upload is not None and upload.link is not link:
            self._refuse(port, link, message, MissionResult.ERROR, Told(Code.TRANSFER_BUSY))
            return
        self._leave(kind, now)
        last = len(items) - 1 if last == -1 else last
        if not 0 <= first <= last < len(items):
            why = Told(Code.NO_SUCH_PART, (first, last, len(items)))
            self._refuse(port, link, message, MissionResult.INVALID_SEQUENCE, why)
            return
        self._upload = Upload(
            port, link, message, kind, list(items), first, last + 1, first, now, now
        )
        self._ask(self._upload, now)

    def _ask(self, upload: Upload, now: float) -> None:
        upload.asked_at = now
        whole = upload.tries % 2 == 0 if upload.whole is None else upload.whole
        to = upload.message.source
        upload.port.send(upload.link, plan_messages.request(upload.next, upload.kind, to, whole))

    def _item(
        self, port: GroundPort, link: Link, message: MissionMessage, t_us: int, now: float
    ) -> None:
        upload, ended = self._upload, self._ended
        if upload is None or upload.link is not link or upload.kind != message.mission_type:
            if (
                ended is not None and ended.link is link and ended.kind == message.mission_type
                and ended.last == message.sequence and now - ended.at < REMEMBERED_S
            ):  # fmt: skip
                self._answer(port, link, message, ended.result)
            elif upload is None or upload.link is not link:
                result = (
                    MissionResult.ERROR if upload is not None else MissionResult.INVALID_SEQUENCE
                )
                port.send(link, plan_messages.ack(result, message.mission_type, message.source))
            return
        upload.heard_at = now
        if message.sequence != upload.next or message.item is None:
            return  # one that was sent twice, or that comes late: the right one is asked for again
        upload.whole, upload.tries = message.kind == "ITEM_INT", 0
        if upload.next < len(upload.items):
            upload.items[upload.next] = message.item
        else:
            upload.items.append(message.item)
        upload.next += 1
        if upload.next < upload.end:
            self._ask(upload, now)
            return
        self._whole(upload, t_us, now)

    def _whole(self, upload: Upload, t_us: int, now: float) -> None:
        """All items are here: take them, or refuse them all."""
        self._upload = upload
        upload.taking = self._takes(upload.kind, tuple(upload.items))
        next(upload.taking)
        self.look_on(t_us, now)

    def _finish(self, upload: Upload, result: MissionResult, told: Told | None, now: float) -> None:
        self._upload = None
        self._ended = Ended(upload.link, upload.kind, upload.end - 1, result, now)
        self._answer(upload.port, upload.link, upload.message, result)
        self._say(upload.kind, result, told)

    def _answer(
        self, port: GroundPort, link: Link, message: MissionMessage, result: MissionResult
    ) -> None:
        kind = message.mission_type
        identity = self.stored.identity(MissionType(kind)) if kind in KINDS else 0
        port.send(link, plan_messages.ack(result, kind, message.source, identity))

    def _refuse(
        self,
        port: GroundPort,
        link: Link,
        message: MissionMessage,
        result: MissionResult,
        why: Told,
    ) -> None:
        port.send(link, plan_messages.ack(result, message.mission_type, message.source))
        self._say(MissionType(message.mission_type), result, why)

    def _say(self, kind: MissionType, result: MissionResult, told: Told | None) -> None:
        if told is None:
            return
        good = result is MissionResult.ACCEPTED
        self._tell(told if good else Told(Code.DENIED, (NAMES[kind], told)), good)

    def _acknowledged(self, link: Link, message: MissionMessage, now: float) -> None:
        """A client has its download, or breaks its upload off, or wants whole numbers."""
        upload = self._upload
        link.downloads.pop(message.mission_type, None)
        if upload is None or upload.link is not link or upload.kind != message.mission_type:
            return
        if message.result == MissionResult.UNSUPPORTED and upload.whole is None:
            upload.whole = True  # it was asked by MISSION_REQUEST, and has no floats
            self._ask(upload, now)
        elif message.result != MissionResult.ACCEPTED:
            self._upload = None
            self._say(upload.kind, MissionResult.CANCELLED, Told(Code.TRANSFER_LOST))

    def _leave(self, kind: MissionType | None, now: float) -> None:
        """Break an upload off for another of its client, and tell so if all of it was here.

        kind : of the other. One that is begun anew needs no answer. None: it is cleared.
        """
        upload, self._upload = self._upload, None
        if upload is not None and upload.taking is not None and upload.kind != kind:
            self._finish(upload, MissionResult.CANCELLED, Told(Code.TRANSFER_LOST), now)

    def _clear(
        self, port: GroundPort, link: Link, message: MissionMessage, t_us: int, now: float
    ) -> None:
        upload = self._others(link)
        if upload is not None:
            if upload.link is not link:
                self._refuse_clear(port, link, message)
                return
            self._leave(None, now)
        kinds = KINDS if message.mission_type == MissionType.ALL else (message.mission_type,)
        for kind in map(MissionType, kinds):
            if self.stored.items[kind]:
                self._clear_kind(kind, t_us)
                self.stored.replace(kind, ())
                self._tell(Told(Code.ITEMS_CLEARED, (NAMES[kind],)), True)
        port.send(
            link, plan_messages.ack(MissionResult.ACCEPTED, message.mission_type, message.source)
        )

    def _clear_kind(self, kind: MissionType, t_us: int) -> None:
        clearing = self._takes(kind, ())
        next(clearing)
        with suppress(StopIteration):
            while True:  # nothing is looked at of nothing
                clearing.send(t_us)

    def _refuse_clear(self, port: GroundPort, link: Link, message: MissionMessage) -> None:
        result, kind = MissionResult.ERROR, message.mission_type
        port.send(link, plan_messages.ack(result, kind, message.source))
        name = "Clearing" if kind == MissionType.ALL else NAMES[MissionType(kind)]
        self._tell(Told(Code.DENIED, (name, Told(Code.TRANSFER_BUSY))), False)

    # --- out

    def _give(self, port: GroundPort, link: Link, message: MissionMessage) -> None:
        kind, to, number = message.mission_type, message.source, message.sequence
        items = link.downloads.get(kind, self.stored.items[MissionType(kind)])
        if number >= len(items):
            port.send(link, plan_messages.ack(MissionResult.INVALID_SEQUENCE, kind, to))
            return
        whole = message.kind == "REQUEST_INT"
        is_current = kind == MissionType.MISSION and number == self._vehicle.mission.current
        packed = plan_messages.item(items[number], number, kind, to, whole, is_current)
        port.send(link, packed)

    # --- told of the plan

    def current(self) -> Packed:
        """MISSION_CURRENT."""
        mission = self._vehicle.mission
        total = len(mission.steps)
        active = self._vehicle.mode is Mode.MISSION
        identities = tuple(self.stored.identity(kind) for kind in KINDS)
        last = max(total - 1, 0)
        return plan_messages.current(
            min(mission.current, last), total, state_of(self._vehicle), active,
            (identities[0], identities[1], identities[2]),
        )  # fmt: skip

    def reached(self) -> Sequence[Packed]:
        """MISSION_ITEM_REACHED of each item that was reached since the last call."""
        mission = self._vehicle.mission
        told = [plan_messages.reached(number) for number in mission.reached]
        mission.reached.clear()
        return told


def state_of(vehicle: StateMachine) -> MissionState:
    """The state of the plan."""
    mission = vehicle.mission
    if not mission.steps:
        return MissionState.NO_MISSION
    if mission.is_complete:
        return MissionState.COMPLETE
    if vehicle.mode is Mode.MISSION and vehicle.armed:
        return MissionState.ACTIVE
    return MissionState.PAUSED if mission.begun else MissionState.NOT_STARTED


def _identity_of(items: Items) -> int:
    if not items:
        return 0
    packed = b"".join(
        struct.pack("<BH4fiif", each.frame, each.command, *each.params, each.x, each.y, each.z)
        for each in items
    )
    return crc32(packed) or 1


def _same(a: MissionMessage, b: MissionMessage) -> bool:
    return a.kind == b.kind and a.total == b.total and a.mission_type == b.mission_type
