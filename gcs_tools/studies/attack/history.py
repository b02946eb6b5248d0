"""One flight looked at: which limit was met when, and what was demanded, flown and learnt."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.studies.attack.draws import Attack
from gcs_tools.studies.attack.flight import AttackFlown, Rows
from gcs_tools.studies.attack.verdict import away, limits, transient_s
from sitl_plant.physics.types import PlantRecord

APART_S = 0.1  # of two events of one limit; closer together they are one
EACH_S = 1.0  # of the summary over time

FLAGS = ("thrust", "tilt", "torque", "yaw")


class Event(NamedTuple):
    """A limit that was met, after the transient."""

    limit: str  # of FLAGS, or "beyond": the demanded force cannot be reached
    from_s: float
    to_s: float
    ticks: int


class Second(NamedTuple):
    """What happened in EACH_S."""

    t_s: float
    margin_n: float  # least
    room_n: float  # least
    condition_n: float  # least
    thrust_n: float  # least commanded
    tilt_deg: float  # greatest, of the vehicle
    torque_nm: float  # greatest demanded about a level axis
    rate_rad_s: float  # greatest body rate about one
    air_m_s: float  # fastest
    speed_m_s: float  # fastest
    off_m: float  # farthest from the reference
    away_m: float  # nearest to the setpoint
    m_hat_kg: float  # last
    governed: float  # part of the ticks


def events(attack: Attack, flown: AttackFlown) -> list[Event]:
    """Every limit that was met, by time."""
    scene, rows = attack.scene, flown.fcu
    begun = round(transient_s(scene) * scene.rate_hz)
    met = limits(scene, rows)
    up = {of: column(Tick, rows, f"outputs.saturation.{of}") > 0.5 for of in FLAGS}
    up["beyond"] = met.margin < 0.0
    found = []
    for name, flags in up.items():
        at = np.flatnonzero(flags[begun:]) + begun
        for part in np.split(at, np.flatnonzero(np.diff(at) > APART_S * scene.rate_hz) + 1):
            if len(part):
                first, last = part[0] / scene.rate_hz, part[-1] / scene.rate_hz
                found.append(Event(name, float(first), float(last), len(part)))
    return sorted(found, key=lambda event: event.from_s)


def columns(attack: Attack, flown: AttackFlown) -> dict[str, Rows]:
    """Time histories by name, float64[ticks] each: SI, Earth axes but for torque and rates (body)."""
    rows, met = flown.fcu, limits(attack.scene, flown.fcu)
    found = {
        "t": column(Tick, rows, "t"),
        "margin": met.margin,
        "room": met.room,
        "condition": column(Tick, rows, "guard.margin.condition"),
        "governed": column(Tick, rows, "guard.governed"),
        "away": away(rows),
        "thrust_c": column(Tick, rows, "outputs.T_c"),
        "thrust": column(Tick, rows, "outputs.T_achieved"),
        "trim": column(Tick, rows, "state.memory.T_trim"),
        "m_hat": column(Tick, rows, "state.estimates.m_hat"),
        "beta": column(Tick, rows, "guard_state.beta"),
    }
    for of in FLAGS:
        found[f"limit_{of}"] = column(Tick, rows, f"outputs.saturation.{of}")
    for name, of in (
        ("r", "measured.r_E"), ("v", "measured.v_E"), ("w", "measured.w_B"),
        ("r_c", "setpoint.r_c"), ("r_m", "outputs.reference.r_m"), ("v_m", "outputs.reference.v_m"),
        ("a_m", "guard_state.a_m"), ("angles", "outputs.angles"), ("angles_c", "outputs.angles_c"),
        ("w_c", "outputs.w_c"), ("demand", "internals.demand.T_0"), ("torque_d", "internals.demand.tau_d"),
        ("torque", "internals.achieved.tau_a"), ("s_v_hat", "state.estimates.s_v_hat"),
        ("s_w_hat", "state.estimates.s_w_hat"), ("J_hat", "state.estimates.J_hat"),
    ):  # fmt: skip
        values = column(Tick, rows, of)
        found.update({f"{name}_{axis}": values[:, i] for i, axis in enumerate("xyz")})
    air = column(PlantRecord, flown.plant, "v_air_E")
    found.update({f"air_{axis}": air[:, i] for i, axis in enumerate("xyz")})
    return found


def seconds(attack: Attack, flown: AttackFlown) -> list[Second]:
    """The flight in parts of EACH_S."""
    c, each = columns(attack, flown), round(EACH_S * attack.scene.rate_hz)

    def size(name: str, axes: str = "xyz") -> Rows:
        return np.asarray(np.sqrt(sum(c[f"{name}_{axis}"] ** 2 for axis in axes)))

    tilt = np.degrees(np.arccos(np.cos(c["angles_x"]) * np.cos(c["angles_y"])))
    off = np.sqrt(sum((c[f"r_{axis}"] - c[f"r_m_{axis}"]) ** 2 for axis in "xyz"))
    torque, rate, air, speed = size("torque_d", "xy"), size("w", "xy"), size("air"), size("v")
    return [
        Second(
            t_s=float(c["t"][k]),
            margin_n=float(c["margin"][k : k + each].min()),
            room_n=float(c["room"][k : k + each].min()),
            condition_n=float(c["condition"][k : k + each].min()),
            thrust_n=float(c["thrust_c"][k : k + each].min()),
            tilt_deg=float(tilt[k : k + each].max()),
            torque_nm=float(torque[k : k + each].max()),
            rate_rad_s=float(rate[k : k + each].max()),
            air_m_s=float(air[k : k + each].max()),
            speed_m_s=float(speed[k : k + each].max()),
            off_m=float(off[k : k + each].max()),
            away_m=float(c["away"][k : k + each].min()),
            m_hat_kg=float(c["m_hat"][k : k + each][-1]),
            governed=float(c["governed"][k : k + each].mean()),
        )
        for k in range(0, len(c["t"]), each)
    ]


def write(attack: Attack, flown: AttackFlown, path: Path) -> None:
    """Every tick as a line of CSV."""
    found = columns(attack, flown)
    rows = np.stack(list(found.values()), axis=1)
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(found), comments="")


def described(attack: Attack) -> dict[str, Any]:
    """What is flown, for people and programs."""
    sent = list(zip(attack.scene.sent_at.tolist(), attack.scene.sent, strict=True))
    rate = attack.scene.rate_hz
    return {
        "setpoints": attack.setpoints,
        "wind": attack.wind,
        "gust": {**attack.gust._asdict(), "along": list(attack.gust.along)},
        **{name: attack.tables[name] for name in ("law", "plant", "wind") if attack.tables[name]},
        "rate_hz": rate,
        "duration_s": attack.scene.ticks / rate,
        "sent": [[k / rate, *s.r_c, *s.v_c, s.psi_c] for k, s in sent],
        "numbers": attack.numbers._asdict(),
    }


def event_table(found: list[Event]) -> Table:
    """For people."""
    shown = Table("limit", "from, s", "to, s", "ticks", box=None, title="limits met after the transient", title_justify="left")  # fmt: skip
    for event in found:
        shown.add_row(event.limit, f"{event.from_s:.3f}", f"{event.to_s:.3f}", str(event.ticks))
    return shown


def second_table(found: list[Second]) -> Table:
    """For people."""
    shown = Table(box=None)
    for name in Second._fields:
        shown.add_column(name, justify="right")
    for second in found:
        shown.add_row(*(f"{value:.3g}" for value in second))
    return shown
