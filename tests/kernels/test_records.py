"""Records: kernels see the contents of the named tuple, and refuse unreadable ones."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit

from ancf2d.kernels.lowlevel.records import Record, whole


class Inner(NamedTuple):
    table: Any
    count: int


class Outer(NamedTuple):
    scale: float
    inner: Inner
    chosen: Any
    phases: Any
    negative: bool


@njit
def read(r, out):  # type: ignore[no-untyped-def]
    sign = -1.0 if r.negative else 1.0
    for i in range(r.inner.table.shape[0]):
        for j in range(r.inner.table.shape[1]):
            if r.chosen[j]:
                out[i] += sign * r.scale * r.inner.table[i, j] * r.inner.count
    out[0] += r.phases[1].imag


@njit
def read_whole(r):  # type: ignore[no-untyped-def]
    t = whole(r)
    return t.scale + t.inner.count + t.inner.table[2, 1] + t.phases[0].real


def outer(negative: bool) -> Outer:
    rng = np.random.default_rng(1)
    return Outer(1.5, Inner(rng.normal(size=(3, 4)), 7), np.array([True, False, True, True]),
                 np.array([1.0 + 2.0j, 3.0 - 4.0j]), negative)


@pytest.mark.parametrize("negative", [False, True])
def test_kernels_read_the_contents_of_the_tuple(negative: bool) -> None:
    values, out = outer(negative), np.zeros(3)
    record = Record(values)
    read(record, out)
    expected = (-1.0 if negative else 1.0) * 1.5 * 7 * values.inner.table[:, values.chosen].sum(axis=1)
    expected[0] -= 4.0
    np.testing.assert_allclose(out, expected, rtol=1e-14)
    assert read_whole(record) == pytest.approx(1.5 + 7 + values.inner.table[2, 1] + 1.0, rel=1e-15)
    assert (record.scale, record.inner.count, record.negative) == (1.5, 7, negative)
    values.inner.table[:] = 0.0
    assert read_whole(record) == 1.5 + 7 + 1.0, "records share the arrays"


def test_arrays_that_are_not_contiguous_are_refused() -> None:
    values = outer(False)
    for table in (values.inner.table.T, values.inner.table.astype(np.float32)):
        with pytest.raises(ValueError, match="cannot be part of a record"):
            Record(values._replace(inner=values.inner._replace(table=table)))


@pytest.mark.parametrize("x", [np.zeros(0), np.arange(6.0)[2:], np.ones((2, 3))[1], np.zeros((4, 0, 2)),
                               np.frombuffer(bytes(16)), np.arange(3), np.ones(2, dtype=complex)])
def test_the_words_of_an_array_are_its_address_and_shape(x: np.ndarray) -> None:
    found = Record(Inner(x, 7))
    at, _ = found.layout.place["table"]
    assert found._words[at:at + 1 + x.ndim].tolist() == [x.ctypes.data, *x.shape]
