"""The declaration is the layout: values, buffers and column names agree."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import pytest

from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel import buffers, rows
from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac.types import Params, State
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from sitl_plant.physics.types import PlantParams, PlantRecord

VALUES = [
    Params, Settings, State, PlantParams, PlantRecord, RotorCommand, Setpoint, Tick, VehicleState,
]  # fmt: skip


class Inner(NamedTuple):
    scale: float
    axis: Vec3


class Outer(NamedTuple):
    first: float
    inner: Inner
    last: float


class Counted(NamedTuple):
    count: int


@pytest.mark.parametrize("cls", VALUES)
def test_a_value_survives_the_buffer(cls):
    buffer = np.arange(1.0, buffers.size(cls) + 1.0)
    np.testing.assert_array_equal(buffers.to_buffer(buffers.from_buffer(cls, buffer)), buffer)


def test_columns_are_dotted_paths():
    assert buffers.columns(Outer) == [
        "first", "inner.scale", "inner.axis.x", "inner.axis.y", "inner.axis.z", "last",
    ]  # fmt: skip


def test_the_hashed_part_of_a_plant_record_is_its_time_and_state():
    hashed = np.array(buffers.columns(PlantRecord))
    assert [hashed[rows.column_of(PlantRecord, "t")], *rows.column(PlantRecord, hashed, "state")] == [
        "t",
        "state.r_E.x", "state.r_E.y", "state.r_E.z",
        "state.v_E.x", "state.v_E.y", "state.v_E.z",
        "state.q_EB.w", "state.q_EB.x", "state.q_EB.y", "state.q_EB.z",
        "state.w_B.x", "state.w_B.y", "state.w_B.z",
        *[f"state.Omega.r{i}" for i in range(1, 9)],
    ]  # fmt: skip


def test_a_leaf_that_is_not_a_float_is_refused():
    with pytest.raises(TypeError, match=r"Counted\.count"):
        buffers.size(Counted)


def test_compiled_unpacking_and_packing_follow_the_same_layout():
    unpack, pack = buffers.unpacker(Outer), buffers.packer(Outer)

    @numba.njit
    def swapped(source, target):
        v = unpack(source)
        pack(target, Outer(v.last, Inner(v.inner.scale, 2.0 * v.inner.axis), v.first))

    target = np.zeros(6)
    swapped(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), target)
    np.testing.assert_array_equal(target, [6.0, 2.0, 6.0, 8.0, 10.0, 1.0])


class Nothing(NamedTuple):
    """No field."""


class Around(NamedTuple):
    before: float
    nothing: Nothing
    after: float


def test_a_value_without_fields_has_a_place_and_no_column():
    assert buffers.columns(Around) == ["before", "after"]
    assert [buffers.offset(Around, name) for name in Around._fields] == [0, 1, 1]
    row = np.zeros(2)
    buffers.packer(Around)(row, Around(1.0, Nothing(), 2.0))
    assert buffers.unpacker(Around)(row) == Around(1.0, Nothing(), 2.0)
