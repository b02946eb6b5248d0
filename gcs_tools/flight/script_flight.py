"""A flight of a mission by a script of the user's: a command that speaks MAVLink with the vehicle.

The runner starts the vehicle and the script, and watches both. It sends no setpoint. A flight that
begins in the air stands until the vehicle is armed, and the vehicle then holds its place until the
script says more.
"""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from fcu.interface import handover
from fcu.interface.link import HOST, UdpLink
from fcu.interface.ports import ports
from fcu.mavlink.framing import Source
from gcs_tools.flight.ground_script import Vehicle, VehicleError
from gcs_tools.flight.pair import Pair
from gcs_tools.flight.processes import WROTE_NOTHING, InfrastructureError
from gcs_tools.flight.scripted_flight import ON_GROUND, Flown, is_aloft
from gcs_tools.flight.user_command import Leashed, filled, names_one_of, with_python
from gcs_tools.flight.wire_flight import STALL_S, WireFlight
from gcs_tools.judging import script_check
from gcs_tools.judging.script_check import ScriptFlown

ARMS = Source(254, 190)  # the system that arms a vehicle in the air
REST_S = 1.0  # simulation time: a vehicle on the ground that stays disarmed for so long has landed
WALL_FACTOR, WALL_S = (
    3.0,
    60.0,
)  # the bound in wall time: so many times what the flight should take, and more
LOG = "script.log"
OF_AN_INSTANCE = ("url", "mavsdk_url", "tcp_url", "port", "instance", "system_id")


def values(instance: int, out: Path, speed: float) -> dict[str, str]:
    """The words in braces of a mission's script, and their values."""
    at = ports(instance)
    return {
        "url": f"udpin:{HOST}:{at.script}",
        "mavsdk_url": f"udpin://{HOST}:{at.script}",
        "tcp_url": f"tcp:{HOST}:{at.fcu_tcp}",
        "port": str(at.script),
        "instance": str(instance),
        "system_id": str(at.system_id),
        "out": str(out.absolute()),
        "speed": f"{speed:g}",
    }


def only_first(words: tuple[str, ...]) -> bool:
    """True if a script is told no instance, so that it can only fly the first."""
    return not names_one_of(words, OF_AN_INSTANCE)


class ScriptFlight(WireFlight):
    """The vehicle and the script of one flight, and what they have flown so far."""

    LINK_CLOCK = "both"  # a script streams setpoints by the clock of the wall
    _pair: Pair
    _script: Leashed
    _outcome: dict[str, Any] | None = None  # of the script's leash
    _began_s = _took_s = 0.0  # wall
    _ended_tick: int | None = None
    _never_waits = False  # it runs while its time is held
    _on_wall = True  # somebody of the script keeps the clock of the wall
    _late = ""  # which time was over while the script ran

    def fly(self) -> Flown:
        """The whole flight. Raises InfrastructureError. What was flown is then in `flown`."""
        flown = super().fly()
        said = flown.said.get("flight controller", {})
        verdict = self._verdict(
            int(said.get("script_messages", 0)), bool(is_aloft(flown.plant).any())
        )
        verdict = replace(
            verdict, parameters=said.get("parameters_set") or {}, by_wall=self._on_wall,
            **self._pace(flown.wall_time_s),
        )  # fmt: skip
        return replace(flown, script=verdict)

    def flown(self) -> Flown:
        """Everything that has arrived so far."""
        flown = super().flown()
        if flown.ended != "time" or not len(flown.fcu) or self._late:
            return flown
        landed = self._is_grounded() and bool(is_aloft(flown.plant).any())  # armed is not flown
        return replace(flown, done="landed" if landed else "script")

    def _pace(self, wall_s: float) -> dict[str, Any]:
        """The pace that was asked for, and the one that was kept."""
        if self._speed is None:
            return {}
        kept = self._flown_ticks() / self._scene.rate_hz / wall_s if wall_s else None
        return {"pace": self._speed, "pace_kept": kept}

    def _led(self, stack: ExitStack) -> Callable[[], bool]:
        scene = self._scene
        if not scene.flight.start.on_ground:
            self._arm_in_the_air()
        told = values(self._instance, self._folder, self._speed or 1.0)
        self._begin(with_python(filled(scene.script, told)))
        stack.callback(self._script.stop)
        return self._watch

    def _begin(self, words: list[str]) -> None:
        """Run the command."""
        self._began_s = time.monotonic()
        self._script = Leashed(
            "script", words, self._scene.folder, self._folder / LOG, self._pair.lifeline()
        )
        self._script.listen()

    def _arm_in_the_air(self) -> None:
        link = UdpLink(0, ports(self._instance).fcu_station)
        vehicle = Vehicle(self._instance, link, ARMS)
        try:
            vehicle.on_wait = self._pair.check
            vehicle.wait_ready()
            vehicle.arm()
        except VehicleError as error:
            raise InfrastructureError(str(error)) from error
        finally:
            vehicle.close()

    def _watch(self) -> bool:
        """Let time run until the flight is over. It never counts as arrived."""
        with suppress(BrokenPipeError):  # the check below says why
            os.write(self._control, handover.GRANT.pack(self._scene.ticks))
        seen, since = -1, time.monotonic()
        while not self._is_finished(self._flown_ticks()):
            if self._collector.error is not None:
                raise InfrastructureError(str(self._collector.error))
            flown = self._flown_ticks()
            self._progress(flown / self._scene.rate_hz)
            if self._is_over() or self._has_ended():
                break
            self._pair.check()
            if flown != seen:
                seen, since = flown, time.monotonic()
            elif time.monotonic() - since > STALL_S:
                raise InfrastructureError(f"no tick was flown for {STALL_S:.0f} s")
            self._collector.wait_for(self._is_over, 0.05)
        if self._outcome is None:
            self._took_s = time.monotonic() - self._began_s
        return False

    def _is_finished(self, tick: int) -> bool:
        """True once the script has ended and the vehicle has come to rest, or a time is over.

        `tick`: how many are flown.
        """
        scene = self._scene
        if self._outcome is None:
            self._outcome = self._script.outcome()
            if self._outcome is not None:
                self._ended_tick, self._took_s = tick, time.monotonic() - self._began_s
        if self._ended_tick is None:
            if tick >= scene.ticks:
                self._late = f"{scene.ticks / scene.rate_hz:g} s of simulation time"
            return self._is_late()
        if not self._outcome or self._outcome.get("exit_code") != 0:
            return True
        since = (tick - self._ended_tick) / scene.rate_hz
        rests = since >= REST_S and self._is_grounded()
        return rests or since >= scene.after_script_s or tick >= scene.ticks

    def _is_late(self) -> bool:
        """True if the simulation time or the wall time that the script has is over."""
        planned_s = self._scene.ticks / self._scene.rate_hz / (self._speed or 1.0)
        most = WALL_FACTOR * planned_s + WALL_S
        if not self._late and time.monotonic() - self._began_s > most:
            self._late = f"{most:g} s of wall time"
        return bool(self._late)

    def _is_grounded(self) -> bool:
        """True if the vehicle is disarmed now, and on the ground."""
        plant, fcu = self._plant_rows.last, self._fcu_rows.last
        if not len(plant) or not len(fcu):
            return False
        return bool(plant[0, ON_GROUND] > 0.5 and not fcu[0, self._engaged] > 0.0)

    def _verdict(self, heard: int, flew: bool) -> ScriptFlown:
        """The end of the script.

        heard : messages that the vehicle had on the script link.  flew : it was in the air, so that a
        script without any has flown it by the port of ground stations.
        """
        said, at = self._outcome, None
        if self._ended_tick is not None:
            at = self._ended_tick / self._scene.rate_hz
        code = None if said is None else said.get("exit_code")
        left = [] if said is None else list(said.get("left", ()))
        failure, text = self._failure(said, heard > 0 or flew)
        return ScriptFlown(
            shlex.join(self._scene.script), code, failure, text, self._took_s, at, heard, left
        )

    def _failure(self, said: dict[str, Any] | None, heard: bool) -> tuple[str, str]:
        """The first failure that applies: its code, and a sentence. Empty for none."""
        if said is not None:
            code, why = said.get("exit_code"), said.get("why")
            if not said:
                return script_check.KILLED, "The script was ended: its leash was killed."
            if code is None:
                return script_check.UNSTARTED, f"The script was not started: {why}."
            if why:
                return script_check.OVERLONG, f"The script was ended: {why} ({LOG})."
            if code < 0:
                return script_check.KILLED, f"Signal {-code} ended the script. {self._words()}"
            if code > 0:
                silent = "" if heard else " It sent the vehicle no MAVLink message."
                return script_check.EXIT, (
                    f"The script ended with exit code {code}.{silent} {self._words()}"
                )
        if not heard and not self._never_waits:
            at = values(self._instance, self._folder, 1.0)
            return script_check.SILENT, (
                "The script sent the vehicle no MAVLink message. Expected one on the script link:"
                f" connect to {{url}}, here {at['url']} ({{mavsdk_url}}, here {at['mavsdk_url']})."
            )
        if said is None and not self._is_over():
            return script_check.TIMEOUT, (
                f"The script had not ended within {self._late}. Give it longer (flight.duration_s, or"
                f" gcs test --duration), or end it earlier. {self._words()}"
            )
        if said is not None and said["left"]:
            return script_check.LEFT, (
                f"The script left processes behind ({', '.join(said['left'])}), which were ended."
                " Wait in the script until they have ended."
            )
        return "", ""

    def _words(self) -> str:
        """The last line that it wrote, as a sentence."""
        last = self._script.last_words()
        return (
            f"It wrote nothing ({LOG})."
            if last == WROTE_NOTHING
            else f"Its last line: {last} ({LOG})"
        )
