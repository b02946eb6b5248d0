"""The end of a mission's script: the command that flew the vehicle, and what was wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs_tools.judging.expectations import Expectation

PACE_KEPT = 0.9  # of the pace, at least
SHORT_S = 1.0  # wall: the pace of a script that ran for less says nothing of the machine
EXIT = "script_exit"  # it ended with an exit code other than 0
KILLED = "script_killed"  # a signal ended it
TIMEOUT = "script_timeout"  # it had not ended when its time was over
SILENT = "script_silent"  # it sent the vehicle no MAVLink message
LEFT = "script_left_processes"  # processes that it had started were still running
OVERLONG = "script_log"  # it wrote more than its log may hold
UNSTARTED = "script_not_started"
DIED = (
    KILLED,
    OVERLONG,
    UNSTARTED,
)  # which end a flight with exit code 3; the others are a missed expectation


@dataclass(frozen=True)
class ScriptFlown:
    """The end of a script."""

    command: str
    exit_code: int | None = None  # None: it did not end by itself
    failure: str = ""  # one of the codes above. Empty: none
    text: str = ""  # the failure as a sentence
    wall_time_s: float = 0.0  # from its start to its end
    ended_at_s: float | None = None  # simulation time
    messages: int = 0  # MAVLink messages that the vehicle had from it
    left: list[str] = field(default_factory=list)  # names of the processes that it left behind
    files: list[str] = field(default_factory=list)  # names of what it left in the folder of the run
    pace: float | None = (
        None  # simulated seconds per second that were asked for. None: time was held
    )
    pace_kept: float | None = None  # and that were flown
    by_wall: bool = (
        False  # it, or a program of it, kept the clock of the wall: no other flight is the same
    )
    parameters: dict[str, float] = field(
        default_factory=dict
    )  # of law and guard, set by MAVLink: the last values

    @property
    def is_slow(self) -> bool:
        """True if this machine did not keep the pace."""
        if self.pace is None or self.pace_kept is None or self.wall_time_s < SHORT_S:
            return False
        return self.pace_kept < PACE_KEPT * self.pace

    def told(self) -> list[str]:
        """Sentences about what changes the meaning of a verdict, and fails no flight."""
        said = []
        if self.by_wall and self.pace is None:
            said.append(
                "The script has threads or programs that keep the clock of the wall (a library like MAVSDK's"
                " does): another flight of it is not the same to the bit."
            )
        if self.is_slow:
            said.append(
                f"The pace was {self.pace_kept:.2g} simulated seconds per second, not {self.pace:g}: this"
                " machine was busy. The script met a vehicle that was slower than it was told."
            )
        if self.parameters:
            values = ", ".join(f"{name} {value:g}" for name, value in self.parameters.items())
            said.append(
                f"The script set parameters of the law or the guard: {values}. The flight is judged with them."
            )
        return said

    def judged(self) -> list[Expectation]:
        """The expectation that nobody has to name: the script ends with 0, and with no failure.

        Of a script that was ended because the vehicle crashed nothing is expected.
        """
        if self.exit_code is None and not self.failure:
            return []
        text, why = "script ends with exit code 0", self.text or None
        value = self.failure or "ok"
        return [Expectation("script", "ok", value, not self.failure, text, why)]
