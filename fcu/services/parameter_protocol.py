"""The parameter protocol: read, set, list, and saved when asked. MAVLink's service.

A parameter that PX4 has as INT32 is one, and may be set as REAL32 too; the others are REAL32.
A value that is refused is answered with the one in force, and the reason in words. Lists are
paced. Files are written by a thread of their own: a disk must not hold up the control loop.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from fcu.interface.status_texts import Code, Told
from fcu.mavlink import replies
from fcu.mavlink.definitions import INT32, REAL32, CommandId, Packed, ParameterError, Result
from fcu.mavlink.ground_link import GroundMessage
from fcu.mavlink.requests import ParamRequestList, ParamRequestRead, ParamSet
from fcu.parameters import Parameters, Refused
from fcu.services.command_protocol import Commands, Request, Spec, Verdict, denied
from fcu.services.ground_port import Bucket, GroundPort, Link
from fcu.vehicle.state_machine import StateMachine

AT_ONCE, EVERY_S = 10, 0.02  # of a list, wall
SETS_PER_S, SETS_AT_ONCE = 20.0, 40.0


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
            return Verdict(Result.FAILED, Told(Code.PARAMETERS_NOT_SAVED, (self._why,)))
        return Verdict(Result.ACCEPTED, Told(Code.PARAMETERS_SAVED))


# to the sender, to everyone, and why it was refused or has no effect
Outcome = tuple[Sequence[Packed], Sequence[Packed], Told | None]


class ParameterProtocol:
    """One for all links."""

    def __init__(
        self, params: Parameters, file: Path | None, vehicle: StateMachine, commands: Commands
    ) -> None:
        """Adds its own to `commands`. `file`: where they are saved when asked."""
        self._params = params
        self._file = file
        self._vehicle = vehicle
        self._sets = Bucket(SETS_PER_S, SETS_AT_ONCE)
        self._commands = commands
        self._saving: Saving | None = None
        self._set_of_law: set[str] = set()  # names that have been set
        commands.table[CommandId.PREFLIGHT_STORAGE] = Spec(
            self._storage, (1, 2, 3), (1,), what="Storage"
        )

    def take(self, message: GroundMessage, link: Link, now: float) -> Outcome | None:
        """(to the sender, to everyone, a warning), or None if it is not of this service."""
        if isinstance(message, ParamRequestList):
            if link.list_at is None:  # one list at a time: asking again does not start it again
                link.list_at, link.list_due = 0, now
            return [], [], None
        if isinstance(message, ParamRequestRead):
            return self._read(message)
        if isinstance(message, ParamSet):
            return self._set(message, now)
        return None

    def _value(self, index: int) -> Packed:
        name = self._params.names[index]
        return replies.param_value(
            name, self._params[name], index, len(self._params),
            self._params.info(name).row.integer,
        )  # fmt: skip

    def _read(self, message: ParamRequestRead) -> Outcome:
        index = message.number
        if index == -1:
            if message.name not in self._params.names:
                return [self._unknown(message, -1)], [], None
            index = self._params.index(message.name)
        if not 0 <= index < len(self._params):
            return [self._unknown(message, index)], [], None
        return [self._value(index)], [], None

    @staticmethod
    def _unknown(message: ParamRequestRead, index: int) -> Packed:
        error = ParameterError.DOES_NOT_EXIST
        return replies.param_error(message.source, message.name, index, error)

    def _set(self, message: ParamSet, now: float) -> Outcome:
        name = message.name
        if name not in self._params.names:
            told = Told(Code.PARAMETER_UNKNOWN, (name,))
            return self._not_set(message, ParameterError.DOES_NOT_EXIST, told)
        integer = self._params.info(name).row.integer
        if message.type != REAL32 and not (integer and message.type == INT32):
            told = Told(Code.PARAMETER_TYPE, (name, "INT32" if integer else "REAL32"))
            return self._not_set(message, ParameterError.TYPE_MISMATCH, told)
        if not self._sets.take(now):
            told = Told(Code.PARAMETERS_TOO_MANY)
            return self._not_set(message, ParameterError.PERMISSION_DENIED, told)
        try:
            changed = self._params.set(name, message.value, self._vehicle.armed)
        except Refused as refused:
            told = Told(Code.PARAMETER_REFUSED, (str(refused), refused.brief))
            return self._not_set(message, ParameterError[refused.kind], told)
        if not changed:
            return [self._value(self._params.index(name))], [], None
        if self._params.is_of_law(name):
            self._set_of_law.add(name)
        also = (self._params.index(each) for each in self._params.changed if each != name)
        values = [self._value(i) for i in (self._params.index(name), *also)]
        is_void = self._params.is_void and self._params.is_of_guard(name)
        return [], values, Told(Code.GUARD_VOID) if is_void else None

    def set_of_law(self) -> dict[str, float]:
        """The parameters of law and guard that were set, with the values in force."""
        return {name: self._params[name] for name in sorted(self._set_of_law)}

    def _not_set(self, message: ParamSet, error: ParameterError, why: Told) -> Outcome:
        """Answered with the value in force, if there is one, and the reason."""
        known = message.name in self._params.names
        index = self._params.index(message.name) if known else -1
        packed = replies.param_error(message.source, message.name, index, error)
        return [*([self._value(index)] if known else []), packed], [], why

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
                return Verdict(Result.DENIED, Told(Code.PARAMETERS_NOT_RESET))
            self._params.reset()
            return Verdict(Result.ACCEPTED, Told(Code.PARAMETERS_RESET))
        if what != 1.0:
            return denied("Storage", Code.SAVES_OR_RESETS)
        if self._file is None:
            return Verdict(Result.DENIED, Told(Code.PARAMETERS_NO_FILE))
        if self._saving is not None:
            return Verdict(Result.TEMPORARILY_REJECTED, Told(Code.PARAMETERS_BEING_SAVED))
        self._saving = Saving(self._params, self._file)
        self._commands.in_progress = self._saved
        return Verdict(Result.IN_PROGRESS)

    def _saved(self) -> Verdict | None:
        """What became of the file; None: still at work."""
        assert self._saving is not None
        verdict = self._saving.done()
        if verdict is not None:
            self._saving = self._commands.in_progress = None
        return verdict
