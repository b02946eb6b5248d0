"""What an attack draws: within what the guard believes by default."""

from __future__ import annotations
from dataclasses import replace
from typing import Any
import numpy as np
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import from_tables
from gcs_tools.studies.attack.flying import FLIPPING, OWN, PUSHING, SQUARE, TURNING, Gust

CLASSES = ("step", "reversal", "stream", "moving", "random")
ATTACK_S = 12.0


def unit(random, n=3):
    v = random.normal(size=n)
    return v / np.linalg.norm(v)


def draw(random, over, end_s):
    """(tables, sent_at s, setpoints, Gust, class)."""
    g = random.uniform
    lg = lambda a, b: float(np.exp(g(np.log(a), np.log(b))))
    law = {
        "f_m": lg(0.4, 3.0),
        "zeta_m": float(g(0.6, 1.2)),
        "gamma": lg(500.0, 5000.0),
        "J_hat_0": float(g(0.1, 0.5)),
        "m_hat_0": float(g(5.0, 10.0)),
    }
    law = {**law, **over}
    J = np.array([0.3245, 0.3245, 0.4616])
    tables = {
        "title": "Drawn.",
        "flight": {
            "duration_s": end_s,
            "rate_hz": int(random.choice([250, 500])),
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "yaw_deg": float(g(-180, 180)) if "start_yaw" in over else 0.0,
            "start": {"yaw_deg": float(g(-180, 180))},
            "setpoints": [[0.0, 0.0, 0.0, 0.0]],
        },
        "law": law,
        "plant": {
            "mass_kg": float(random.choice([7.0, 9.0])),
            "inertia_kg_m2": (J * random.choice([0.876, 1.1248], 3)).tolist()
            if random.random() < 0.5
            else (J * g(0.876, 1.1248, 3)).tolist(),
            "drag": g(0.05, 0.15, 3).tolist(),
            "rotor_lag_s": float(g(0.03, 0.08)),
        },
        "wind": {},
        "expect": {},
    }
    kind = CLASSES[random.integers(5)]
    f_m = law["f_m"]
    n3 = unit(random)
    if random.random() < 0.4:
        n3 = np.array([0, 0, 1.0]) * random.choice([-1, 1])
    elif random.random() < 0.5:
        n3[2] = 0
        n3 /= np.linalg.norm(n3)
    t, pts, vel = [], [], []
    if kind == "step":
        t, pts = [0.0], [n3 * lg(0.2, 40)]
    elif kind == "reversal":
        a = n3 * lg(0.1, 20)
        T = float(g(0.1, 3.0)) / f_m
        n = int(random.integers(2, 9))
        t = [k * T for k in range(n + 1)]
        pts = [a if k % 2 == 0 else -a for k in range(n + 1)]
    elif kind in ("stream", "moving"):
        R, v = lg(0.5, 10), float(g(1, 9))
        e1 = unit(random)
        e2 = np.cross(e1, unit(random))
        e2 /= np.linalg.norm(e2)
        w = v / R
        t = list(np.arange(0, ATTACK_S, 0.05))
        pts = [R * (np.cos(w * x) * e1 + np.sin(w * x) * e2) - R * e1 for x in t]
        if kind == "moving":
            vel = [R * w * (-np.sin(w * x) * e1 + np.cos(w * x) * e2) for x in t]
        t.append(ATTACK_S)
        pts.append(pts[-1])
        vel = vel and vel + [np.zeros(3)]
    else:
        far = lg(0.1, 20)
        x = 0.0
        every = lg(0.05, 2.0)
        while x < ATTACK_S:
            t.append(x)
            pts.append(unit(random) * far * random.random())
            x += every * g(0.5, 1.5)
    t, pts = [0.0, *[2.0 + x for x in t]], [np.zeros(3), *pts]
    vel = vel and [np.zeros(3), *vel]
    yaw, yaws = float(np.radians(tables["flight"]["start"]["yaw_deg"])), []
    steps = random.random() < 0.5
    for k in range(len(t)):
        if k and steps and (k == 1 or random.random() < min(1.0, 0.5)):
            if kind not in ("stream", "moving") or random.random() < 0.05:
                yaw = float(g(-np.pi, np.pi))
        yaws.append(yaw)
    sent = [
        Setpoint(
            r_c=Vec3(*map(float, p)),
            v_c=Vec3(*(map(float, vel[k]) if vel else (0.0, 0.0, 0.0))),
            a_c=Vec3(0.0, 0.0, 0.0),
            psi_c=yaws[k],
            psi_dot_c=0.0,
        )
        for k, p in enumerate(pts)
    ]
    gk = (OWN, SQUARE, TURNING, FLIPPING, PUSHING)[random.integers(5)]
    speed = 12.0 if random.random() < 0.5 else float(g(0, 12))
    if gk == OWN:
        tables["wind"] = {"steady_m_s": (unit(random) * speed).tolist()}
    gust = Gust(
        gk, speed, 20.0, float(g(0.3, 4.0)), *(n3 if random.random() < 0.7 else unit(random))
    )
    return tables, np.array(t), sent, gust, kind


def scene_of(tables, t, sent, policy, over) -> Scenario:
    law = {**tables["law"], "guard": policy}
    scene = scenario(from_tables("drawn", {**tables, "law": law}))
    at = np.round(np.array(t) * scene.rate_hz).astype(np.int64)
    keep = np.concatenate([np.diff(at) > 0, [True]])
    at, sent = at[keep], [s for s, k in zip(sent, keep) if k]
    return replace(scene, sent_at=at, sent=tuple(sent))
