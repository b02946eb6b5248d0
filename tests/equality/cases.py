"""Command lines whose every output is recorded: flights, verdicts, refusals, campaigns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.equality.ground_traffic import GROUND_FLIGHTS

FLY = ("gcs_tools", "fly")
NEVER = ("--figure", "never")
LAWS = "mmrac", "px4", "se3", "indi", "l1"
AIRFRAMES = "s1000", "quad", "hexa", "x8", "racer"


class Case(NamedTuple):
    """Command lines run one after the other in a folder of their own, each a module and its arguments."""

    name: str
    commands: tuple[tuple[str, ...], ...]
    files: dict[str, str] = {}  # noqa: RUF012  that lie there before
    held: tuple[int, ...] = ()  # ports that somebody else holds
    ground: str = ""  # one of GROUND_FLIGHTS, in place of command lines


def cases(checkout: Path) -> Iterator[Case]:
    """All of them. `checkout`: whose missions and laws are flown."""
    yield from _missions(checkout)
    yield from _laws(checkout)
    yield from _verdicts()
    yield from _raising(checkout)
    yield from _refusals()
    yield from _before_flight(checkout)
    yield from _campaigns()
    for name in GROUND_FLIGHTS:
        yield Case(f"ground/{name}", (), ground=name)


def _fly(name: str, *words: str, files: dict[str, str] | None = None, both: bool = True) -> Iterator[Case]:  # fmt: skip
    """A flight over the wire, and one in process."""
    ways = {"wire": ("--record", "light"), "process": ("--in-process", "--record", "none")}
    for way, options in ways.items():
        if both or way == "process":
            command = (*FLY, *words, "--out", "run", "--junit", "junit.xml", *NEVER, *options)
            yield Case(f"{name}/{way}", (command,), files or {})


def _missions(checkout: Path) -> Iterator[Case]:
    folder = checkout / "missions"
    for path in sorted(folder.rglob("*.toml")):
        name = path.relative_to(folder).with_suffix("").as_posix()
        if not name.startswith("campaigns/"):
            yield from _fly(f"missions/{name}", name)


def _laws(checkout: Path) -> Iterator[Case]:
    own = str(checkout / "tests/own_law/plain_cascade.py")
    for law in (*LAWS, own):
        of = Path(law).stem
        for airframe in ("s1000", "quad"):
            name = f"laws/{of}-{airframe}"
            yield from _fly(name, "airframe_step", "--law", law, "--airframe", airframe, both=False)
    for law in ("px4", "se3", "indi", "l1"):
        yield from _fly(f"laws/{law}-gusts", "benchmark/gusts", "--law", law)
    for airframe in AIRFRAMES:
        words = "airframe_noise", "--airframe", airframe, "--seed", "3"
        yield from _fly(f"airframes/{airframe}", *words, both=False)
    yield from _fly("laws/own", str(checkout / "tests/own_law/step_in_still_air.toml"))
    for guard in ("govern", "refuse", "warn"):
        words = "paper_fast", "--set", f'law.guard="{guard}"'
        yield from _fly(f"guards/{guard}", *words)


STEP = """title = "A step."
[flight]
duration_s = 4.0
ground_z_m = {ground}
{more}
setpoints = [{{ at_s = 0.0, position_m = {to} }}]
[plant]
{plant}
[expect]
{expect}
"""


def _step(
    to: str = "[1.0, 0.0, 3.0]", ground: float = -10.0, more: str = "", plant: str = "",
    expect: str = "",
) -> dict[str, str]:  # fmt: skip
    return {"step.toml": STEP.format(to=to, ground=ground, more=more, plant=plant, expect=expect)}


def _verdicts() -> Iterator[Case]:
    step = "step.toml"
    yield from _fly("verdicts/passing", step, files=_step())
    yield from _fly("verdicts/failing", step, files=_step(expect="setpoint_error_final_m = 1e-9"))
    crash = _step(ground=-0.5, plant="mass_kg = 60.0")
    yield from _fly("verdicts/crashing", step, files=crash)
    expected = _step(ground=-0.5, plant="mass_kg = 60.0", expect='ended = "crashed"')
    yield from _fly("verdicts/crashing-as-expected", step, files=expected)
    yield from _fly("verdicts/refused-setpoint", step, "--set", 'law.guard="refuse"', files=_step("[60.0, 0.0, 40.0]"))  # fmt: skip
    yield from _fly("verdicts/out-of-arena", step, "--set", "flight.arena_m=2", files=_step())
    heavy = _step(more="start = { on_ground = true }", ground=0.0, plant="mass_kg = 30.0")
    yield from _fly("verdicts/does-not-lift", step, files=heavy)
    yield from _fly("verdicts/diverging", "paper_printed_fast", "--set", "flight.duration_s=60")
    yield from _fly("verdicts/seeds", "noisy_state", "--seed", "1..3", "-j", "1")
    several = "missions/..", step, "gust_step", "nowhere", "wind_step"
    yield from _fly("verdicts/several", *several, "-j", "2", files=_step())
    words = (*FLY, step, "--out", "run", *NEVER)
    yield Case("verdicts/json", ((*words, "--json"),), _step())
    yield Case("verdicts/full", ((*words, "--record", "full"),), _step())
    yield Case("verdicts/rate", ((*words, "--rate", "250"),), _step())
    twice = tuple(
        (*FLY, "gust_step", "--seed", seed, "--out", out, *NEVER) for seed, out in (("1", "a"), ("2", "b"))
    )  # fmt: skip
    after = (
        ("gcs_tools", "compare", "a", "b"), ("gcs_tools", "compare", "a", "b", "--json"),
        ("gcs_tools", "plot", "a", "--json"), ("gcs_tools", "plot", "a", "--what", "limits", "--from", "1"),
        ("gcs_tools", "recover", "a/flight.mcap"),
    )  # fmt: skip
    yield Case("verdicts/afterwards", (*twice, *after))
    yield Case("verdicts/occupied-folder", (words, words), _step())
    controller = (*words, "--controller-timeout", "2", "--controller")
    yield Case("verdicts/controller-that-ends", ((*controller, "false"),), _step())
    yield Case("verdicts/controller-not-there", ((*controller, "/nowhere/controller"),), _step())
    foreign = "{checkout}/tests/foreign_controller/"
    flies = "{python} " + foreign + "cascade.py {{instance}} {{airframe}}"
    words = (*FLY, foreign + "step_in_still_air.toml", "--out", "run", *NEVER)
    yield Case("verdicts/controller", ((*words, "--controller", flies),))


RAISES = """
@kernel
def step(state, params, setpoint, measured):
    if measured.r_E.x > 0.3:
        raise ValueError("east of all reason")
"""


def _raising(checkout: Path) -> Iterator[Case]:
    law = (checkout / "tests/own_law/plain_cascade.py").read_text()
    start = "\n@kernel\ndef step(state, params, setpoint, measured):\n"
    step = {**_step()}
    own = "step.toml", "--law", "own.py"
    texts = {
        "raises": law.replace(start, RAISES),
        "raises-at-import": "raise ValueError('not today')\n",
        "syntax-error": law + "\ndef (\n",
        "lacks-step": law.replace("def step(", "def stride("),
        "does-not-compile": law.replace(start, start + "    nowhere = setpoint.nowhere\n"),
    }
    for name, text in texts.items():
        yield from _fly(f"own-law/{name}", *own, files={**step, "own.py": text})
    nan = law.replace(start, start + "    measured = measured._replace(r_E=measured.r_E * math.nan)\n")  # fmt: skip
    yield from _fly("own-law/not-finite", *own, files={**step, "own.py": "import math\n" + nan})
    yield from _fly("own-law/missing", "step.toml", "--law", "nowhere.py", files=step)
    yield from _fly("own-law/unknown-name", "step.toml", "--law", "mrac", files=step)


BAD_MISSIONS = {
    "empty": "",
    "not-toml": "title = \n",
    "unknown-key": _step(more="heigth = 3.0")["step.toml"],
    "unknown-table": _step()["step.toml"] + "[winds]\nsteady_m_s = [1.0, 0.0, 0.0]\n",
    "wrong-type": _step(plant='mass_kg = "heavy"')["step.toml"],
    "out-of-range": _step(plant="mass_kg = -1.0")["step.toml"],
    "not-finite": _step(to="[nan, 0.0, 1.0]")["step.toml"],
    "unknown-metric": _step(expect="setpoint_errors_m = 1.0")["step.toml"],
    "below-ground": _step(to="[0.0, 0.0, -3.0]", ground=-1.0)["step.toml"],
    "starts-in-the-ground": _step(ground=0.0)["step.toml"],
    "too-far": _step(to="[900.0, 0.0, 3.0]")["step.toml"],
    "unknown-item": 'title = "X."\n[flight]\nduration_s = 5.0\n[[flight.items]]\nkind = "dance"\n',
    "two-kinds": _step()["step.toml"] + '[[flight.items]]\nkind = "land"\n',
}
BAD_WORDS = {
    "gain-f_m": ("paper_nominal", "--set", "law.f_m=5"),
    "gain-c_rate": ("paper_nominal", "--set", "law.c_rate=150"),
    "gain-negative": ("paper_nominal", "--set", "law.f_m=-1"),
    "gain-take-off": ("take_off", "--set", "law.f_m=5"),
    "gain-items": ("square_and_land", "--set", "law.f_m=5"),
    "gain-of-px4": ("airframe_step", "--law", "px4", "--set", "law.rate_p=50"),
    "unknown-gain": ("paper_nominal", "--set", "law.f_n=1"),
    "not-a-table": ("paper_nominal", "--set", "f_m=1"),
    "no-value": ("paper_nominal", "--set", "law.f_m"),
    "no-file": ("nowhere.toml",),
    "no-mission": ("paper_nominl",),
    "no-words": (),
    "bad-seed": ("paper_nominal", "--seed", "-1"),
    "bad-rate": ("paper_nominal", "--rate", "7"),
    "bad-option": ("paper_nominal", "--fast"),
    "bad-jobs": ("paper_nominal", "-j", "0"),
    "no-airframe": ("paper_nominal", "--airframe", "zeppelin"),
    "no-zenoh": ("gust_step", "--publish", "--zenoh", "nowhere.json5"),
    "both-ways": ("gust_step", "--in-process", "--speed", "2"),
    "no-campaign": ("nowhere#3",),
}
BAD_AIRFRAMES = {
    "empty": "",
    "unknown-key": "{quad}\nwheels = 4\n",
    "nine-rotors": 'name = "nine"\n[rotors]\ncount = 9\n',
}
INSTANCE_0 = {"plant": 4560, "controller": 4660, "script": 14580, "ground-script": 14540, "station": 18570}  # fmt: skip


def _refusals() -> Iterator[Case]:
    out = "--out", "run", "--record", "none", *NEVER
    for name, text in BAD_MISSIONS.items():
        commands = (
            (*FLY, "bad.toml", *out, "--junit", "junit.xml"),
            (*FLY, "bad.toml", "--out", "next", *out[2:], "--in-process"),
            ("gcs_tools", "envelope", "bad.toml"),
        )
        yield Case(f"refusals/mission-{name}", commands, {"bad.toml": text})
    for name, words in BAD_WORDS.items():
        process = "--in-process", "--record", "none", "--json", *NEVER
        commands = ((*FLY, *words, *out), (*FLY, *words, "--out", "next", *process))
        yield Case(f"refusals/words-{name}", commands)
    for name, text in BAD_AIRFRAMES.items():
        commands = (
            ("gcs_tools", "airframe", "bad.toml"),
            (*FLY, "airframe_step", "--airframe", "bad.toml", *out),
            ("fcu", "--airframe", "bad.toml"), ("sitl_plant", "--airframe", "bad.toml"),
        )  # fmt: skip
        yield Case(f"refusals/airframe-{name}", commands, {"bad.toml": text})
    for name, port in INSTANCE_0.items():
        commands = (
            (*FLY, "gust_step", "--instance", "0", *out, "--junit", "junit.xml"),
            (*FLY, "gust_step", "--out", "next", *NEVER),
        )
        yield Case(f"refusals/busy-{name}", commands, held=(port,))
    processes = (
        ("fcu", "--instance", "99"), ("fcu", "--law", "nowhere"), ("fcu", "--rate", "7"),
        ("fcu", "--origin", "1,2"), ("fcu", "--params", "."), ("fcu", "--params", "bad.params"),
        ("fcu", "--handover", "bad.json"), ("sitl_plant", "--world", "bad.json"),
        ("sitl_plant", "--world", "nowhere.json"), ("sitl_plant", "--rate", "-1"),
        ("sitl_plant", "--speed", "backwards"),
        ("sitl_plant", "--world", "bad.json", "--airframe", "quad"),
    )  # fmt: skip
    files = {"bad.json": "{}", "bad.params": "1 1 MR_F_M fast 9\n"}
    yield Case("refusals/processes", processes, files)
    plots = (
        ("plot", "nowhere"), ("plot", "."), ("plot", "bad.mcap"), ("plot", "bad.mcap", "--what", "x"),
        ("recover", "bad.mcap"), ("recover", "nowhere.mcap"), ("replay", "bad.mcap"),
        ("compare", "nowhere", "."), ("compare", "mmrac", "nowhere.py", "--missions", "gust_step"),
        ("tune", "nowhere.py"), ("tune", "mrac"), ("reset", "--instance", "77"), ("setpoint", "1", "2"),
    )  # fmt: skip
    commands = tuple(("gcs_tools", *words) for words in plots)
    yield Case("refusals/pictures", commands, {"bad.mcap": "not a recording"})
    campaign = (
        "", "title = 3\n", 'mission = "nowhere"\n', 'mission = "gust_step"\nflights = 0\n',
        'mission = "gust_step"\nflights = 3\n[draw]\n"plant.mass" = { uniform = [1.0, 2.0] }\n',
        'mission = "gust_step"\nflights = 3\n[draw]\n"plant.mass_kg" = { uniform = [2.0, 1.0] }\n',
        'mission = "gust_step"\nflights = 3\n[draw]\n"law.f_m" = { uniform = [4.0, 6.0] }\n',
    )  # fmt: skip
    for number, text in enumerate(campaign):
        commands = (("gcs_tools", "campaign", "bad.toml", "--out", "run"),)
        yield Case(f"refusals/campaign-{number}", commands, {"bad.toml": text})
    words = (
        ("campaign", "nowhere"),
        ("campaign", "paper_noise", "--flights", "0"),
        ("campaign", "."),
    )
    yield Case("refusals/campaign-words", tuple(("gcs_tools", *each) for each in words))
    helped = (
        "fly", "up", "setpoint", "reset", "envelope", "airframe", "tune", "compare", "campaign", "plot",
        "view", "recover", "replay", "monitor", "record", "topics", "publish",
    )  # fmt: skip
    commands = (
        ("fcu", "--help"), ("sitl_plant", "--help"), ("gcs_tools", "--help"),
        *(("gcs_tools", name, "--help") for name in helped),
    )  # fmt: skip
    yield Case("help", commands)


def _before_flight(checkout: Path) -> Iterator[Case]:
    for airframe in AIRFRAMES:
        words = "gcs_tools", "airframe", airframe
        yield Case(f"before/airframe-{airframe}", (words, (*words, "--json")))
    for path in sorted((checkout / "missions").glob("*.toml")):
        words = "gcs_tools", "envelope", path.stem
        yield Case(f"before/envelope-{path.stem}", ((*words, "--json"),))
    words = "gcs_tools", "envelope", "paper_fast"
    more = ("--set", "law.f_m=5"), ("--set", "law.c_rate=150"), ("--airframe", "quad"), ()
    yield Case("before/envelope", tuple((*words, *each) for each in more))


OFTEN_FAILS = """title = "Mass, delay and wind beyond what the vehicle was made for."
mission = "benchmark/gusts"
flights = 60
[draw]
"plant.mass_kg" = { uniform = [0.5, 2.2], relative = true }
"plant.delay_s" = { uniform = [0.0, 0.06] }
"wind.steady_m_s[0]" = { uniform = [-14.0, 14.0] }
[success]
setpoint_error_final_m = 0.2
"""
WITH_ITEMS = """title = "Take-off, square and landing with a mass that is not known."
mission = "airframe_tour"
flights = 40
[draw]
"plant.mass_kg" = { uniform = [0.8, 1.3], relative = true }
"wind.azimuth_deg" = { uniform = [0.0, 360.0] }
"""


def _campaigns() -> Iterator[Case]:
    for name, text in {"often-fails": OFTEN_FAILS, "with-items": WITH_ITEMS}.items():
        words = "gcs_tools", "campaign", "own.toml", "--out", "run", "--junit", "junit.xml"
        yield Case(f"campaigns/{name}", (words,), {"own.toml": text})
    words = "gcs_tools", "campaign", "paper_noise", "--flights", "100", "--out", "run"
    yield Case("campaigns/paper_noise", (words, (*FLY, "run#7", "--out", "again", *NEVER)))
