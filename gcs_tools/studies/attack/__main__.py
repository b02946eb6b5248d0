
import sys, json, time, collections
import numpy as np
from concurrent.futures import ThreadPoolExecutor
from gcs_tools.studies.attack.draws import draw, scene_of
from gcs_tools.studies.attack.flying import fly
from fcu.guard.stability import unstable
from fcu.guard import foreseen
from fcu.kernel.rows import column
from fcu.tick import Tick
policy, n, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
over = json.loads(sys.argv[4]) if len(sys.argv) > 4 else {}
plant_over = json.loads(sys.argv[5]) if len(sys.argv) > 5 else {}
only = sys.argv[6] if len(sys.argv) > 6 else ""
END = 30.0
def one(k):
    random = np.random.default_rng([seed, k])
    while True:
        tables, t, sent, gust, kind = draw(random, over, END)
        tables["plant"].update(plant_over)
        scene = scene_of(tables, t, sent, policy, over)
        if not unstable(scene.law) and (not only or kind in only): break
    plant, rows, admitted = fly(scene, gust)
    rate = scene.rate_hz
    tr = max(float(foreseen.transient_s(scene.guard, scene.law)), 0.5)
    s = round(tr * rate)
    c = lambda name: column(Tick, rows[s:], name)
    sat = {x: float((c("outputs.saturation." + x) > .5).mean()) for x in ("thrust", "tilt")}
    for x in ("torque", "yaw", "rotor"):
        try: sat[x] = float((c("outputs.saturation." + x) > .5).mean())
        except Exception: pass
    marg = float(c("guard.margin.force").min())
    cond = float(c("guard.margin.condition").min())
    away = np.linalg.norm(column(Tick, rows, "measured.r_E") - column(Tick, rows, "setpoint.r_c"), axis=1)
    lost = len(rows) < scene.ticks or away.max() > 200 or away[-1] > 50
    m = c("state.estimates.m_hat")
    late = np.linalg.norm(column(Tick, rows[-round(2*rate):], "outputs.e_r"), axis=1).max()
    return dict(k=k, kind=kind, gust=int(gust.kind), sat=sat, margin=marg, cond=cond, lost=bool(lost), end=float(away[-1]), e_r=float(late), m=(float(m.min()), float(m.max())), M=tables["plant"]["mass_kg"], f=tables["law"]["f_m"], adm=float(admitted.mean()))
t0 = time.time()
with ThreadPoolExecutor(2) as pool: res = list(pool.map(one, range(n)))
bad = [r for r in res if r["sat"]["torque"] > 0 or r["sat"]["thrust"] > 0 or r["sat"]["tilt"] > 0 or r["margin"] < 0]
print(policy, over, "flights", n, "thrust/tilt", len(bad), "torque", sum(r["sat"].get("torque", r["sat"].get("rotor")) > 0 for r in res), "lost", sum(r["lost"] for r in res), "not there", sum(r["end"] > .3 for r in res), "worst margin %.1f" % min(r["margin"] for r in res), "%.0f s" % (time.time() - t0))
print("  rotor frac median %.4f p90 %.4f" % tuple(np.quantile([r["sat"].get("rotor", max(r["sat"].get("torque",0), r["sat"].get("yaw",0))) for r in res], (.5, .9))), "admitted %.2f" % np.mean([r["adm"] for r in res]), "m/M %.2f..%.2f" % (min(r["m"][0]/r["M"] for r in res), max(r["m"][1]/r["M"] for r in res)))
print("  bad by kind", collections.Counter(r["kind"] for r in bad), "gust", collections.Counter(r["gust"] for r in bad))
for r in sorted(res, key=lambda r: -r["sat"]["yaw"])[:12]: print("  Y", {k: (round(v, 3) if isinstance(v, float) else v) for k, v in r.items()})
for r in sorted(bad, key=lambda r: r["margin"])[:6]: print("  ", {k: (round(v, 3) if isinstance(v, float) else v) for k, v in r.items()})
