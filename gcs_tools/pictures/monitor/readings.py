"""The numbers of the monitor: a followed flight, read now, of late and over time."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs_tools.pictures.follower import Follower
from gcs_tools.pictures.history import Series
from gcs_tools.pictures.quantities import parts
from gcs_tools.recording.table import Rows

LOOK_S = 5.0  # wall: over which the speed of the flight is measured
RECENT_S = 10.0  # simulation time: what "of late" means


class Readings:
    """What is known of a flight. NaN: not known."""

    def __init__(self, follower: Follower) -> None:
        self.follower = follower
        self.flight = follower.flight
        self._looks: list[tuple[float, float]] = []  # wall, simulation time

    @property
    def t(self) -> float:
        """Simulation time of the last tick, s."""
        span = self.flight.span
        return span[1] if span else math.nan

    def speed(self) -> float:
        """Simulated seconds in one of the wall clock, over the last looks at it."""
        now, t = time.monotonic(), self.t
        self._looks = [*(look for look in self._looks if now - look[0] < LOOK_S), (now, t)]
        wall, first = self._looks[0]
        return max((t - first) / (now - wall), 0.0) if now > wall else math.nan

    def last(self, name: str) -> float:
        """A column in its last row."""
        _, values = self.flight.series(name)
        return float(values[-1]) if len(values) else math.nan

    def vector(self, name: str) -> list[float]:
        """A Vec3 in its last row."""
        return [self.last(part) for part in parts(name)]

    def recent(self, series: Series) -> Rows:
        """The values of the last RECENT_S that are known."""
        t, values = series
        found: Rows = values[t > (t[-1] - RECENT_S if len(t) else 0.0)]
        return found[np.isfinite(found)]

    def rms(self, series: Series) -> float:
        """Of late."""
        found = self.recent(series)
        return float(np.sqrt(np.mean(found * found))) if len(found) else math.nan

    def now(self, series: Series) -> float:
        """The last value that is known: what came last of one side may be yet to come of another."""
        known = series[1][np.isfinite(series[1])]
        return float(known[-1]) if len(known) else math.nan

    def size(self, names: Sequence[str]) -> Series:
        """The length over time of what has these components, as far as the law flies."""
        found = [self.flight.flown(name) for name in names]
        return found[0] if len(found) == 1 else (found[0][0], np.sqrt(sum(v * v for _, v in found)))

    @property
    def flies(self) -> bool:
        """Whether the law flies."""
        return self.last("engaged") > 0.5

    @property
    def believed_drag(self) -> str:
        """The coefficients that the wind estimate believes in, N/(m/s)^2, as text."""
        told = self.follower.vehicle.about.get("believed_drag")
        try:
            drag: Any = json.loads(told) if isinstance(told, str) else told
            return ", ".join(f"{float(c):g}" for c in drag)
        except (TypeError, ValueError):
            return "?"

    def lost(self, who: str) -> int:
        """Ticks of "fcu" or "plant" that did not come."""
        counted = self.follower.vehicle.counted
        return sum(c.lost for topic, c in counted.items() if topic.startswith(f"/{who}/"))

    @property
    def strange(self) -> int:
        """Samples that were not the vehicle's."""
        vehicle = self.follower.vehicle
        unreadable = sum(c.unreadable for c in vehicle.counted.values())
        return self.follower.unusable + vehicle.unknown + unreadable

    def snapshot(self) -> dict[str, Any]:
        """The numbers of one picture, for programs. None: not known."""
        vehicle, flown = self.follower.vehicle, self.flight.flown
        known = {
            "time_s": self.t,
            "off_reference_m": self.now(flown("position_error")),
            "off_reference_rms_m": self.rms(flown("position_error")),
            "thrust_N": self.now(flown("outputs.T_c")),
            "roll_deg": self.now(flown("roll_c")),
            "pitch_deg": self.now(flown("pitch_c")),
            "margin_N": self.now(flown("guard.margin.force")),
            "margin_deg": math.degrees(self.now(flown("guard.margin.tilt"))),
            "margin_condition_N": self.now(flown("guard.margin.condition")),
            "governed": self.now(flown("guard.governed")),
            "mass_kg": self.last("state.estimates.m_hat") if self.flies else math.nan,
            "wind_error_rms_m_s": self.rms(flown("wind_error")),
        }
        vectors = {
            "position_m": self.vector("state.r_E"),
            "reference_m": self.vector("outputs.reference.r_m"),
            "wind_estimate_m_s": self.vector("wind.v_air_E"),
            "wind_m_s": self.vector("v_air_E"),
        }
        plan = self.flight.plans.at(math.inf)
        return {
            "schema": 1,
            "run": vehicle.about.get("run"),
            "vehicle": vehicle.about.get("vehicle"),
            "alive": sorted(vehicle.alive),
            "status": self.flight.status(self.t) or None,
            "plan_item": plan.current if plan.mission else None,
            "plan_items": len(plan.mission) or None,
            **{name: _known(value) for name, value in known.items()},
            **{name: [_known(v) for v in vector] for name, vector in vectors.items()},
            "ticks": {topic: c.ticks for topic, c in vehicle.counted.items()},
            "lost": {topic: c.lost for topic, c in vehicle.counted.items() if c.lost},
        }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
