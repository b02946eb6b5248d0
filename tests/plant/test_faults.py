"""Faults to order: what each does to rotors, reported state and battery, at which ticks."""

from __future__ import annotations

import numpy as np
import pytest

import gcs_tools
from fcu.interface.faults import MOST, SPECS, FaultsError, Kind, fault, load, save
from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.rows import column, column_of
from fcu.laws.loader import LawError
from fcu.mavlink import failures
from fcu.mavlink.failures import Order, Type, Unit
from fcu.mavlink.plant_link import PlantCodec, Result
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import MissionError, from_tables
from gcs_tools.recording import reader as recording
from sitl_plant import burst
from sitl_plant.burst import WIDTH, PlantRow
from sitl_plant.physics.world import world
from sitl_plant.simulator import Simulator

AIRBORNE = {"position_m": (0.0, 0.0, 50.0)}
PERIOD_US, CHARGE = 2000, 0
HOVER = 0.6
_X, _REMAINING = column_of(VehicleState, "r_E.x"), column_of(Battery, "remaining")


class Ticks:
    """A simulator in the air whose rotors are all commanded alike, and what each tick has shown."""

    def __init__(self, *tables, seed=1, **plant):
        there = world(start=AIRBORNE, seed=seed, plant=plant, ground_z_m=-1e4)
        ordered = [fault(table) for table in tables]
        self.simulator = Simulator(there, 1, lambda event: None, ordered=ordered)
        self.plant = self.simulator.plant
        self.rows, self.reported, self.commands, self.failed, self.remaining = [], [], [], [], []

    def fly(self, n, command=HOVER):
        for _ in range(n):
            self.simulator.draw_noise()
            row = np.zeros(WIDTH)
            now, _, _ = burst.observe(self.plant, row)
            self.rows.append(row)
            self.reported.append(self.plant.reported.copy())
            self.failed.append(int(self.plant.desk.quality[0]))
            self.remaining.append(self.plant.battery[_REMAINING])
            self.plant.command[:] = command if np.ndim(command) else command + 1e-4 * now
            burst.advance(self.plant, now)
            self.commands.append(self.plant.command.copy())
        return self

    def truth(self, name):
        return column(PlantRow, np.array(self.rows), name)


def test_a_motor_that_is_off_stands_and_turns_again():
    told = Ticks({"kind": "motor_off", "at_s": 0.02, "for_s": 0.01, "rotor": 3}).fly(30)
    commands = np.array(told.commands)
    assert (commands[:, 2] == 0.0).tolist() == [10 <= k < 15 for k in range(30)]
    assert (np.delete(commands, 2, axis=1) > 0.5).all()
    Omega = told.truth("state.Omega")[:, 2]
    assert Omega[15] < 0.9 * Omega[10]
    assert Omega[29] > Omega[16]


def test_a_motor_without_a_number_is_every_motor():
    told = Ticks({"kind": "motor_off", "at_s": 0.0}).fly(3)
    assert not np.array(told.commands).any()


def test_a_motor_that_is_stuck_keeps_the_command_of_the_tick_before():
    told = Ticks({"kind": "motor_stuck", "at_s": 0.02, "for_s": 0.01, "rotor": 1}).fly(20)
    first = np.array(told.commands)[:, 0]
    assert first.tolist() == [HOVER + 1e-4 * (9 if 10 <= k < 15 else k) for k in range(20)]


def test_a_weak_motor_gives_its_share_and_then_all_of_it_again():
    weak = {"kind": "motor_weak", "at_s": 0.02, "for_s": 0.02, "effectiveness": 0.5}
    whole, told = Ticks().fly(21), Ticks(weak).fly(21)
    T, halved = whole.truth("T"), told.truth("T")
    assert np.array_equal(T[:10], halved[:10])
    assert halved[10:20] == pytest.approx(0.5 * T[10:20], rel=1e-12)
    assert halved[20] == pytest.approx(T[20], rel=1e-12)


def test_a_weak_motor_is_what_a_lost_rotor_is():
    lost = Ticks(rotor_loss=[{"rotor": 2, "at_s": 0.02, "effectiveness": 0.4}]).fly(30)
    weak = Ticks({"kind": "motor_weak", "at_s": 0.02, "rotor": 2, "effectiveness": 0.4}).fly(30)
    assert np.array_equal(np.array(lost.rows), np.array(weak.rows))


def test_a_lost_rotor_that_is_weak_too_gives_the_product():
    lost = [{"rotor": 1, "at_s": 0.01, "effectiveness": 0.5}]
    weak = {"kind": "motor_weak", "at_s": 0.02, "for_s": 0.01, "rotor": 1, "effectiveness": 0.5}
    told = Ticks(weak, rotor_loss=lost).fly(16).truth("T")
    Omega = Ticks().fly(16)
    f = Omega.truth("T") / 8.0
    share = [1.0 if k < 5 else 0.5 if k < 10 else 0.25 if k < 15 else 0.5 for k in range(16)]
    assert told == pytest.approx([f[k] * (7.0 + share[k]) for k in range(16)], rel=1e-12)


def test_a_state_that_is_stuck_or_off_is_that_of_the_tick_before():
    for kind, failed in (("state_stuck", 0), ("state_off", -1)):
        told = Ticks({"kind": kind, "at_s": 0.01, "for_s": 0.02}).fly(20, 0.9)
        state = told.truth("state")
        assert [np.array_equal(r, state[4]) for r in told.reported[5:15]] == [True] * 10
        assert np.array_equal(told.reported[15], state[15])
        assert told.failed == [failed if 5 <= k < 15 else 0 for k in range(20)]


def test_a_state_that_is_stuck_or_off_from_the_first_tick_on_is_that_of_the_first():
    for kind in ("state_stuck", "state_off"):
        told = Ticks({"kind": kind, "at_s": 0.0, "for_s": 0.01}).fly(6, 0.9)
        state = told.truth("state")
        assert [np.array_equal(r, state[0]) for r in told.reported] == [True] * 5 + [False]


def test_a_delayed_state_is_as_old_as_it_says_and_never_older_than_the_flight():
    told = Ticks({"kind": "state_delayed", "at_s": 0.004, "for_s": 0.02, "delay_s": 0.01}).fly(20)
    state = told.truth("state")
    ages = [0 if not 2 <= k < 12 else min(k, 5) for k in range(20)]
    assert [np.array_equal(told.reported[k], state[k - ages[k]]) for k in range(20)] == [True] * 20


def test_a_jump_is_of_the_position_alone():
    jump = {"kind": "state_jumps", "at_s": 0.01, "for_s": 0.01, "jump_m": [1.0, -2.0, 3.0]}
    told = Ticks(jump).fly(12)
    off = np.array(told.reported) - told.truth("state")
    assert off[5:10, :3] == pytest.approx(np.tile([1.0, -2.0, 3.0], (5, 1)), abs=1e-12)
    assert not off[:, 3:].any()
    assert not off[[4, 10], :3].any()


def test_noise_is_of_the_seed_and_of_its_size():
    noisy = {
        "kind": "state_noisy", "at_s": 0.1, "for_s": 4.0,
        "noise": {"position_m": 0.5, "velocity_m_s": 0.2},
    }  # fmt: skip
    told, again, other = (Ticks(noisy, seed=seed).fly(2050) for seed in (1, 1, 2))
    assert np.array_equal(told.reported, again.reported)
    off = np.array(told.reported) - told.truth("state")
    assert not off[:50].any()
    assert off[50:2050, :3].std() == pytest.approx(0.5, rel=0.05)
    assert off[50:2050, 3:6].std() == pytest.approx(0.2, rel=0.05)
    assert not np.array_equal(off[50:60], (np.array(other.reported) - other.truth("state"))[50:60])


def test_a_battery_is_drained_beside_its_loads_and_reports_at_most_its_level():
    drained = Ticks({"kind": "battery_drain", "at_s": 0.0, "for_s": 0.02, "drain_a": 1000.0}).fly(
        21
    )
    charge = drained.truth("battery.drawn_Ah")[20] - Ticks().fly(21).truth("battery.drawn_Ah")[20]
    assert 3600.0 * charge == pytest.approx(20.0, rel=1e-3)
    level = {"kind": "battery_level", "at_s": 0.1, "for_s": 0.1, "remaining": 0.3}
    told = Ticks(level).fly(151)
    assert told.remaining[49] > 0.9
    assert told.remaining[50] == told.remaining[99] == 0.3
    assert told.remaining[100] > 0.9


# --- by command


def test_an_order_holds_from_the_command_that_has_not_come_yet():
    told = Ticks().fly(10)
    assert told.simulator.fail(Order(Unit.MOTOR, Type.STUCK, 1, 0.0, 0.006)) is Result.ACCEPTED
    told.fly(5)
    first = np.array(told.commands)[:, 0]
    assert first[9:].tolist() == [HOVER + 1e-4 * k for k in (9, 9, 9, 9, 13, 14)]


def test_ok_ends_what_was_ordered_of_one_rotor_or_of_all():
    told = Ticks().fly(2)
    for rotor in (1, 2, 3):
        told.simulator.fail(Order(Unit.MOTOR, Type.OFF, rotor, 0.0, 0.0))
    told.fly(1)
    told.simulator.fail(Order(Unit.MOTOR, Type.OK, 2, 0.0, 0.0))
    told.fly(1)
    told.simulator.fail(Order(Unit.MOTOR, Type.OK, 0, 0.0, 0.0))
    told.fly(1)
    off = (np.array(told.commands)[2:, :4] == 0.0).tolist()
    assert off == [[True] * 3 + [False], [True, False, True, False], [False] * 4]


def test_ok_of_one_rotor_ends_for_it_a_fault_of_all_which_goes_on_for_the_others():
    told = Ticks().fly(2)
    told.simulator.fail(Order(Unit.MOTOR, Type.OFF, 0, 0.0, 0.006))
    told.simulator.fail(Order(Unit.MOTOR, Type.OK, 2, 0.0, 0.0))
    told.fly(4)
    off = (np.array(told.commands)[2:] == 0.0).tolist()
    assert off == [[True, False, *[True] * 6]] * 3 + [[False] * 8]


def test_ok_of_one_rotor_is_not_done_where_there_is_no_room_for_the_others():
    told = Ticks().fly(2)
    for _ in range(MOST // 7 + 1):
        told.simulator.fail(Order(Unit.MOTOR, Type.OFF, 0, 0.0, 0.0))
    ok = Order(Unit.MOTOR, Type.OK, 2, 0.0, 0.0)
    assert told.simulator.fail(ok) is Result.TEMPORARILY_REJECTED
    assert not told.fly(1).commands[-1].any()


def test_of_two_faults_of_a_rotor_the_one_that_was_given_later_wins():
    told = Ticks().fly(2)
    for type_, for_s in ((Type.STUCK, 0.002), (Type.OFF, 0.0)):
        told.simulator.fail(Order(Unit.MOTOR, type_, 1, 0.0, for_s))
    told.fly(2)  # the first is over, and gives its place away
    told.simulator.fail(Order(Unit.MOTOR, Type.STUCK, 1, 0.0, 0.0))
    told.simulator.fail(Order(Unit.MOTOR, Type.OFF, 1, 0.0, 0.002))
    told.simulator.fail(Order(Unit.MOTOR, Type.WRONG, 1, 0.0, 0.0))
    assert [row[0] for row in told.plant.struck.table[:4]] == [
        Kind.MOTOR_OFF, Kind.MOTOR_STUCK, Kind.MOTOR_OFF, Kind.MOTOR_WEAK,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("order", "result"),
    [
        (Order(Unit.MOTOR, Type.OFF, 9, 0.0, 0.0), Result.DENIED),
        (Order(Unit.MOTOR, Type.WRONG, 1, 1.5, 0.0), Result.DENIED),
        (Order(Unit.MOTOR, Type.GARBAGE, 1, 0.0, 0.0), Result.UNSUPPORTED),
        (Order(Unit.VIO, Type.OFF, 2, 0.0, 0.0), Result.DENIED),
        (Order(4, Type.OFF, 0, 0.0, 0.0), Result.UNSUPPORTED),
        (Order(4, Type.OK, 0, 0.0, 0.0), Result.UNSUPPORTED),
    ],
)
def test_what_cannot_be_done_is_not_acknowledged(order, result):
    told = Ticks()
    assert told.simulator.fail(order) is result
    assert told.plant.struck.used[0] == 0


@pytest.mark.computes
def test_every_unit_and_type_that_is_listed_is_done_and_no_other():
    for unit in range(110):
        for type_ in Type:
            done = Ticks().simulator.fail(Order(unit, type_, 0, 0.0, 0.0)) is Result.ACCEPTED
            listed = (unit, type_) in failures.ROWS or (type_ == Type.OK and unit in set(Unit))
            assert done == listed, (unit, type_)


def test_faults_that_are_over_make_room():
    told = Ticks()
    order = Order(Unit.MOTOR, Type.OFF, 1, 0.0, 0.002)
    for _ in range(MOST):
        assert told.simulator.fail(order) is Result.ACCEPTED
    assert told.simulator.fail(order) is Result.TEMPORARILY_REJECTED
    told.fly(1)
    assert told.simulator.fail(order) is Result.ACCEPTED


def test_an_order_that_comes_twice_is_done_once_and_acknowledged_twice():
    told, codec = Ticks(), PlantCodec(1)
    order = Order(Unit.MOTOR, Type.WRONG, 1, 0.25, 3.0)
    for again in (False, True):
        datagram = codec.pack_failure(order, 7, again)
        assert told.simulator.codec.failure(datagram) == (order, 7)
        answer = told.simulator.answer_failure(datagram)
        assert codec.failure_answer(answer) == (Result.ACCEPTED, 7)
    assert told.plant.struck.used[0] == 1
    assert told.simulator.answer_failure(codec.pack_reset()) is None
    assert codec.failure_answer(told.simulator.codec.pack_reset_done()) is None


# --- files


def test_faults_come_out_of_a_file_as_they_went_in(tmp_path):
    tables = [
        {"kind": "motor_off", "at_s": 0.1}, {"kind": "state_jumps", "at_s": 1 / 3, "jump_m": [1.0, 2.0, 3.0]},
        {"kind": "state_noisy", "at_s": 0.0, "for_s": 0.7, "noise": {"attitude_deg": 1.0}},
    ]  # fmt: skip
    ordered = tuple(map(fault, tables))
    save(tmp_path / "faults.json", ordered)
    assert load(tmp_path / "faults.json") == ordered


@pytest.mark.parametrize("text", ["", "{}", "[{}]", '[{"kind": 1}]', "[1]"])
def test_a_file_that_holds_no_faults_is_refused(tmp_path, text):
    (tmp_path / "faults.json").write_text(text)
    with pytest.raises(FaultsError, match=r"faults\.json"):
        load(tmp_path / "faults.json")


def mission(*faults, **plant):
    flight = {
        "duration_s": 1.0, "start": AIRBORNE,
        "setpoints": [{"at_s": 0.0, "position_m": AIRBORNE["position_m"]}],
    }  # fmt: skip
    return from_tables(
        "faults", {"title": "Faults.", "flight": flight, "plant": {"faults": faults, **plant}}
    )


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ({"kind": "motor_of", "at_s": 0.0}, "motor_off"),
        ({"kind": "motor_off", "at_s": 0.0, "rotor": 9}, "8"),
        ({"kind": "motor_weak", "at_s": 0.0}, "effectiveness"),
        ({"kind": "motor_off", "at_s": 0.0, "delay_s": 0.1}, "state_delayed"),
        ({"kind": "state_off", "at_s": 0.0, "rotor": 1}, "motor_off"),
        ({"kind": "state_delayed", "at_s": 0.0, "delay_s": 0.6}, "0.5"),
        ({"kind": "state_off"}, "at_s"),
        ({"kind": "state_off", "at_s": 0.0, "for_s": 0.0}, "for_s"),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused_in_words(table, why):
    with pytest.raises(MissionError, match="faults") as refused:
        mission(table)
    assert why in str(refused.value)


def test_a_rotor_that_the_airframe_does_not_have_is_refused():
    tables = mission({"kind": "motor_off", "at_s": 0.0, "rotor": 5}).given
    with pytest.raises(MissionError, match="expected 1 to 4"):
        from_tables("faults", {**tables, "airframe": "quad"})


def test_every_kind_is_flown_or_needs_an_autopilot_and_says_so():
    values = {
        "effectiveness": 0.9, "noise": {"position_m": 0.01}, "delay_s": 0.01, "jump_m": [1.0, 0.0, 0.0],
        "drain_a": 10.0, "remaining": 0.5, "share": 0.5, "late_s": 0.01,
    }  # fmt: skip
    assert {spec.kind for spec in SPECS.values()} == set(Kind)
    for name, spec in SPECS.items():
        table = {"kind": name, "at_s": 0.5, **{k: values[k] for k in spec.keys if k in values}}
        scene = scenario(mission(table))
        if name in ("state_off", "battery_drain", "battery_level", "ground_lost"):
            with pytest.raises(LawError, match=f"{name} is answered by an autopilot"):
                law_alone.fly(scene)
        else:
            plant, _ = law_alone.fly(scene)
            assert len(plant) == scene.ticks


@pytest.mark.slow
def test_a_flight_with_faults_is_the_same_over_the_wire_and_in_process(tmp_path):
    faults = [
        '{kind="motor_weak",at_s=0.5,for_s=1,rotor=1,effectiveness=0.6}',
        '{kind="motor_off",at_s=1,for_s=0.1,rotor=2}', '{kind="motor_stuck",at_s=1.3,for_s=0.2}',
        '{kind="state_noisy",at_s=1.5,for_s=0.5,noise={position_m=0.02,attitude_deg=0.3}}',
        '{kind="state_delayed",at_s=2,for_s=0.3,delay_s=0.01}',
        '{kind="state_jumps",at_s=2.5,for_s=0.2,jump_m=[3,0,0]}',
        '{kind="state_stuck",at_s=2.8,for_s=0.05}', '{kind="battery_level",at_s=1,remaining=0.1}',
    ]  # fmt: skip
    settings = ["flight.duration_s=3", f"plant.faults=[{','.join(faults)}]"]
    rows = []
    for name in ("wire", "in_process"):
        flown = gcs_tools.fly(
            "paper_nominal", settings=settings, in_process=name == "in_process",
            out=tmp_path / name, figure="never",
        )  # fmt: skip
        assert flown.error is None
        rows.append(recording.read(tmp_path / name / "flight.mcap"))
    assert rows[0].plant.rows.tobytes() == rows[1].plant.rows.tobytes()
    assert rows[0].plant.rows.shape[0] == 1500


@pytest.mark.parametrize(
    "fault",
    [
        '{kind="link_lost",at_s=0.5,for_s=0.1,share=0.2}', '{kind="link_doubled",at_s=0.2,share=0.5}',
        '{kind="link_reordered",at_s=0.2,share=0.5}',
        '{kind="link_late",at_s=0.5,for_s=0.1,share=0.3,late_s=0.01}',
    ],
    ids=["lost", "doubled", "reordered", "late"],
)  # fmt: skip
@pytest.mark.slow
def test_a_link_that_loses_doubles_or_delays_states_changes_no_bit_of_a_flight(tmp_path, fault):
    rows = []
    for name, faults in (("whole", ""), ("torn", fault)):
        flown = gcs_tools.fly(
            "paper_nominal", settings=["flight.duration_s=1", f"plant.faults=[{faults}]"],
            out=tmp_path / name, figure="never",
        )  # fmt: skip
        assert flown.error is None
        rows.append(recording.read(tmp_path / name / "flight.mcap").plant.rows)
    assert rows[0].tobytes() == rows[1].tobytes()


def test_a_failure_of_all_rotors_says_so():
    def words(kind, rotor):
        return failures.words(Order(Unit.MOTOR, kind, rotor, 0.0, 0.0))

    assert words(Type.OK, 0) == "motor, all" and words(Type.OK, 2) == "motor 2"
    assert words(Type.OFF, 0) == "motor off, all"
