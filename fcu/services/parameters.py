"""The parameter protocol: read, set, list, and saved when asked. MAVLink's service, REAL32.

A value that is refused is answered with the one in force, and the reason in words. Lists are
paced. Files are written by a thread of their own: a disk must not hold up the control loop.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from fcu.mavlink import answers
from fcu.mavlink.enums import CommandId, Result
from fcu.mavlink.framing import Packed
from fcu.mavlink.ground_messages import GroundMessage, ParamRequestList, ParamRequestRead, ParamSet
from fcu.parameters import Parameters, Refused
from fcu.services.commands import Request, Spec
from fcu.services.port import Bucket, GroundPort, Link
from fcu.vehicle.supervisor import Supervisor
from fcu.vehicle.verdict import Verdict

REAL32 = 9
AT_ONCE, EVERY_S = 10, 0.02  # of a list, wall
SETS_PER_S, SETS_AT_ONCE = 20.0, 40.0
ERRORS = {
    "DOES_NOT_EXIST": 1, "VALUE_OUT_OF_RANGE": 2, "PERMISSION_DENIED": 3, "READ_ONLY": 5,
    "TYPE_MISMATCH": 7,
}  # fmt: skip


class Saving:
    """A file that is being written; asked until it is done."""

    def __init__(self, params: Parameters, path: Path) -> None:
        self._why: str | None = None
        text = params.text()  # as of now, whatever is set while the disk works

        def run() -> None:
            try:
                params.write(path, text)
                self._why = ""
            except OSError as error:
                self._why = error.strerror or str(error)

        self._thread = threading.Thread(target=run, name="parameters", daemon=True)
        self._thread.start()

    def done(self) -> Verdict | None:
        """What became of it; None: still at work."""
        if self._thread.is_alive() or self._why is None:
            return None
        if self._why:
            return Verdict(Result.FAILED, f"Parameters not saved: {self._why}")
        return Verdict(Result.ACCEPTED, "Parameters saved")


class ParameterService:
    """One for all links."""

    def __init__(
        self, params: Parameters, file: Path | None, vehicle: Supervisor, table: dict[int, Spec]
    ) -> None:
        """Adds its command to `table`. `file`: where they are saved when asked."""
        self._params = params
        self._file = file
        self._vehicle = vehicle
        self._sets = Bucket(SETS_PER_S, SETS_AT_ONCE)
        self.saving: Saving | None = None
        table[CommandId.PREFLIGHT_STORAGE] = Spec(self._storage, (1, 2, 3), (1,), what="Storage")

    def take(
        self, message: GroundMessage, link: Link, now: float
    ) -> tuple[Sequence[Packed], Sequence[Packed], str] | None:
        """(to the sender, to everyone, a reason in words), or None if it is not of this service."""
        if isinstance(message, ParamRequestList):
            if link.list_at is None:  # one list at a time: asking again does not start it again
                link.list_at, link.list_due = 0, now
            return [], [], ""
        if isinstance(message, ParamRequestRead):
            return self._read(message)
        if isinstance(message, ParamSet):
            return self._set(message, now)
        return None

    def _value(self, index: int) -> Packed:
        name = self._params.names[index]
        return answers.param_value(name, self._params[name], index, len(self._params))

    def _read(self, message: ParamRequestRead) -> tuple[Sequence[Packed], Sequence[Packed], str]:
        index = message.number
        if index == -1:
            if message.name not in self._params.names:
                error = answers.param_error(
                    message.source, message.name, -1, ERRORS["DOES_NOT_EXIST"]
                )
                return [error], [], ""
            index = self._params.index(message.name)
        if not 0 <= index < len(self._params):
            return (
                [
                    answers.param_error(
                        message.source, message.name, index, ERRORS["DOES_NOT_EXIST"]
                    )
                ],
                [],
                "",
            )
        return [self._value(index)], [], ""

    def _set(self, message: ParamSet, now: float) -> tuple[Sequence[Packed], Sequence[Packed], str]:
        name = message.name
        try:
            if name not in self._params.names:
                raise Refused("DOES_NOT_EXIST", f"Parameter {name}: there is none such")
            if message.type != REAL32:
                raise Refused("TYPE_MISMATCH", f"Parameter {name}: it is a REAL32")
            if not self._sets.take(now):
                raise Refused("PERMISSION_DENIED", "Parameters: too many at once, ask again")
            if not self._params.set(name, message.value, self._vehicle.armed):
                return [self._value(self._params.index(name))], [], ""
        except Refused as refused:
            known = name in self._params.names
            index = self._params.index(name) if known else -1
            error = answers.param_error(message.source, name, index, ERRORS[refused.kind])
            return [*([self._value(index)] if known else []), error], [], str(refused)
        also = (self._params.index(each) for each in self._params.changed if each != name)
        return [], [self._value(i) for i in (self._params.index(name), *also)], ""

    def pace(self, port: GroundPort, now: float) -> None:
        """The next few of each list that is being sent."""
        for link in port.everyone():
            if link.list_at is not None and now >= link.list_due:
                until = min(link.list_at + AT_ONCE, len(self._params))
                port.send(link, *[self._value(i) for i in range(link.list_at, until)])
                link.list_at = until if until < len(self._params) else None
                link.list_due = now + EVERY_S

    def _storage(self, request: Request) -> Verdict:
        what = request.parameter(1)
        if what == 2.0:
            if self._vehicle.armed:
                return Verdict(Result.DENIED, "Parameters not reset: armed")
            self._params.reset()
            return Verdict(Result.ACCEPTED, "Parameters as at the start")
        if what != 1.0:
            return Verdict(Result.DENIED, "Storage denied: 1 saves, 2 resets")
        if self._file is None:
            return Verdict(Result.DENIED, "Parameters not saved: no file was named (--params FILE)")
        if self.saving is not None:
            return Verdict(Result.TEMPORARILY_REJECTED, "Parameters are being saved")
        self.saving = Saving(self._params, self._file)
        return Verdict(Result.IN_PROGRESS)
