"""Commands from their arrival to their acknowledgement: waited for, repeated, explained.

What a command does is `commands` and `requests`; here is only how its sender learns of it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from fcu.mavlink import answers
from fcu.mavlink.enums import CommandId, Result, Severity
from fcu.mavlink.ground_messages import Command
from fcu.mavlink.kinds import command_name
from fcu.services.commands import Commands, Request
from fcu.services.parameters import ParameterService
from fcu.services.port import Acknowledged, Bucket, GroundPort, Link
from fcu.services.requests import Requests
from fcu.vehicle.script import Script
from fcu.vehicle.verdict import Verdict

REMEMBERED, REPEAT_S = 8, 5.0  # acknowledgements of a link, for so long (wall), for repetitions
PENDING_S = 0.5  # wall: how long a command waits for the second setpoint of a stream
REASONS_S, REASONS_AT_ONCE = 10.0, 50.0  # of refusals in words: a second (wall), and at once
WAIT_FOR_A_STREAM = (CommandId.SET_MODE, CommandId.SET_STANDARD_MODE, CommandId.ARM_DISARM)


@dataclass
class Pending:
    """A command that is answered later."""

    command: Command
    port: GroundPort
    link: Link
    outcome: Callable[[int, float], Verdict | None]


class Desk:
    """Where commands are handed in. One for all links."""

    def __init__(
        self, commands: Commands, requests: Requests, parameters: ParameterService, script: Script,
        tell: Callable[[Severity, str], None],
    ) -> None:  # fmt: skip
        """`tell`: words to everyone."""
        self._commands = commands
        self._requests = requests
        self._parameters = parameters
        self._script = script
        self._tell = tell
        self._pending: dict[int, Pending] = {}  # by command
        self._reasons = Bucket(REASONS_S, REASONS_AT_ONCE)

    def take(
        self, port: GroundPort, link: Link, command: Command, t_us: int, now: float
    ) -> None:  # fmt: skip
        """Carry a command out, or begin to, or acknowledge once more. `now`: wall, s."""
        if self._is_pending(port, link, command, now) or self._is_repeated(
            port, link, command, now
        ):
            return
        verdict = self._commands.answer(Request(command, t_us, now))
        later = self._later(command, verdict, now)
        if later is not None:
            self._pending[command.command] = Pending(command, port, link, later)
            _acknowledge(port, link, command, Result.IN_PROGRESS)
            return
        self._conclude(port, link, command, verdict, now)

    def settle(self, t_us: int, now: float) -> None:
        """Acknowledge what has come to its end."""
        for number, pending in list(self._pending.items()):
            verdict = pending.outcome(t_us, now)
            if verdict is None:
                continue
            del self._pending[number]
            saving = self._parameters.saving
            if saving is not None and saving.done() is not None:
                self._parameters.saving = None
            self._conclude(pending.port, pending.link, pending.command, verdict, now)

    def explain(self, verdict: Verdict, now: float) -> None:
        """The words of a verdict, to everyone; reasons of refusals not without end."""
        if verdict.text and (verdict.good or self._reasons.take(now)):
            self._tell(Severity.INFO if verdict.good else Severity.WARNING, verdict.text)

    def _is_pending(self, port: GroundPort, link: Link, command: Command, now: float) -> bool:
        pending = self._pending.get(command.command)
        if pending is None:
            return False
        if _asked(pending.command) == _asked(command):  # counted as a repetition or not
            _acknowledge(port, link, command, Result.IN_PROGRESS)
        else:
            _acknowledge(port, link, command, Result.TEMPORARILY_REJECTED)
            text = f"{command_name(command.command)} rejected: one is still being done"
            self.explain(Verdict(Result.TEMPORARILY_REJECTED, text), now)
        return True

    def _is_repeated(self, port: GroundPort, link: Link, command: Command, now: float) -> bool:
        """Whether its answer was lost. What only asks is not remembered: it is answered anew."""
        if command.confirmation == 0:
            return False
        known = [
            known for known in link.acknowledged
            if known.command == command.command and now - known.at < REPEAT_S
        ]  # fmt: skip
        same = next((each for each in known if each.asked == _asked(command)), None)
        if same is None:
            return False
        if same is known[0]:
            _acknowledge(port, link, command, same.result)
        else:  # to do it now would undo what was asked for later
            _acknowledge(port, link, command, Result.DENIED)
            text = f"{command_name(command.command)}: a late repetition, not done"
            self.explain(Verdict(Result.DENIED, text), now)
        return True

    def _later(
        self, command: Command, verdict: Verdict, now: float
    ) -> Callable[[int, float], Verdict | None] | None:
        """How to go on asking about a command that is not done yet; None if it is."""
        saving = self._parameters.saving
        if verdict.result is Result.IN_PROGRESS and saving is not None:
            return lambda _t_us, _now: saving.done()
        rejected = verdict.result is Result.TEMPORARILY_REJECTED
        if rejected and command.command in WAIT_FOR_A_STREAM and self._script.setpoint is not None:
            # the first setpoint of a stream came just before: the second is on its way
            until = now + PENDING_S

            def entered(t_us: int, at: float) -> Verdict | None:
                verdict = self._commands.answer(Request(command, t_us, at))
                return verdict if verdict.good or at >= until else None

            return entered
        return None

    def _conclude(
        self, port: GroundPort, link: Link, command: Command, verdict: Verdict, now: float
    ) -> None:
        if command.command not in self._requests.commands:
            done = Acknowledged(command.command, _asked(command), verdict.result, now)
            link.acknowledged = [done, *link.acknowledged][:REMEMBERED]
        _acknowledge(port, link, command, verdict.result)
        self.explain(verdict, now)  # after: who waits for the answer then hears the reason


def _acknowledge(port: GroundPort, link: Link, command: Command, result: Result) -> None:
    port.send(link, answers.command_ack(command.command, result, command.source))


def _asked(command: Command) -> bytes:
    """What makes two commands the same: who asks, and the bits of what is asked (NaN is NaN)."""
    return struct.pack("<HH7d", *command.source, *command.params)
