"""A row is read by name: numbers, values and whole rows, one or many, also in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import pytest

from fcu.interface.diagnostics import Report, fcu_row
from fcu.kernel import buffers
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column, column_of, joined, slice_of, view
from fcu.process.tick import Tick
from sitl_plant.physics.types import PlantRecord


class Inner(NamedTuple):
    scale: float
    axis: Vec3


class Outer(NamedTuple):
    first: float
    inner: Inner
    last: float


class Another(NamedTuple):
    inner_too: Inner
    end: float


ROW = np.arange(6.0)
ROWS = np.stack([ROW, ROW + 10.0])


@pytest.mark.parametrize("cls", [Tick, PlantRecord, fcu_row(Tick)])
def test_every_column_is_found_by_its_name(cls):
    names = buffers.columns(cls)
    assert [column_of(cls, name) for name in names] == list(range(buffers.size(cls)))


def test_a_number_and_a_value_of_one_row_and_of_many():
    assert column(Outer, ROW, "inner.scale") == 1.0
    assert column(Outer, ROW, "inner.axis").tolist() == [2.0, 3.0, 4.0]
    assert column(Outer, ROWS, "last").tolist() == [5.0, 15.0]
    assert column(Outer, ROWS, "inner").tolist() == [[1.0, 2.0, 3.0, 4.0], [11.0, 12.0, 13.0, 14.0]]


def test_what_is_read_is_not_copied():
    rows = ROWS.copy()
    column(Outer, rows, "inner.axis")[:] = 7.0
    assert view(Outer, rows).inner.axis.y.tolist() == [7.0, 7.0]


def test_a_view_is_a_value_of_numbers_or_of_columns():
    assert view(Outer, ROW) == Outer(0.0, Inner(1.0, Vec3(2.0, 3.0, 4.0)), 5.0)
    assert view(Outer, ROWS).inner.axis.z.tolist() == [4.0, 14.0]


def test_a_row_may_go_on_behind_its_value():
    assert view(Inner, ROW) == Inner(0.0, Vec3(1.0, 2.0, 3.0))


def test_classes_joined_are_one_row():
    both = joined("Both", Outer, Another)
    assert slice_of(both, "inner_too.axis") == slice(7, 10)
    assert buffers.columns(both) == [*buffers.columns(Outer), *buffers.columns(Another)]
    assert slice_of(fcu_row(Tick), "wind").start == buffers.size(Tick)
    assert buffers.size(fcu_row(Tick)) == buffers.size(Tick) + buffers.size(Report)


def test_names_that_there_are_not_are_refused():
    with pytest.raises(AttributeError, match=r"Outer has no field inner\.axes"):
        column(Outer, ROW, "inner.axes")
    with pytest.raises(AttributeError, match="first"):
        slice_of(Outer, "first.of.it")
    with pytest.raises(TypeError, match="more than one column"):
        column_of(Outer, "inner")


class Namesake(NamedTuple):
    z: float


Namesake.__name__ = Inner.__name__


class Pair(NamedTuple):
    here: Inner
    there: Namesake


def test_two_classes_of_one_name_are_kept_apart():
    value = buffers.from_buffer(Pair, np.arange(5.0))
    assert type(value.here) is Inner and type(value.there) is Namesake
    assert value.there.z == 4.0


def test_compiled_code_reads_and_writes_a_field_of_a_row():
    get, put = buffers.unpacker(Outer, "inner.axis"), buffers.packer(Outer, "inner.axis")
    get_last, put_last = buffers.unpacker(Outer, "last"), buffers.packer(Outer, "last")

    @numba.njit
    def doubled(row):
        put(row, 2.0 * get(row))
        put_last(row, get_last(row) + 1.0)

    row = ROW.copy()
    doubled(row)
    assert row.tolist() == [0.0, 1.0, 4.0, 6.0, 8.0, 6.0]
