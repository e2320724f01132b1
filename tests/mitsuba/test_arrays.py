"""Arrays of the plug-ins: numbers of NumPy and torch in memory that rows are read from at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spmm_torch.mitsuba.arrays import (
    ALIGNMENT,
    float_array,
    half_array,
    index_array,
    power_of_two,
    row,
)

SIZES = (8, 1000, 100_000, 5_000_000)  # NumPy aligns small and large arrays to 16 bytes alone


@pytest.mark.parametrize("build", [float_array, half_array, index_array])
@pytest.mark.parametrize("size", SIZES)
def test_arrays_begin_where_rows_can_be_read_at_once(mi: Any, build: Any, size: int) -> None:
    import drjit as dr

    array = build(np.arange(size) % 1000)
    assert np.array_equal(np.array(array), np.arange(size) % 1000)
    assert np.from_dlpack(dr.detach(array)).ctypes.data % ALIGNMENT == 0


@pytest.mark.parametrize("count", [1, 2, 3, 4, 8, 16])
def test_rows_are_those_of_the_table(mi: Any, count: int) -> None:
    table = np.random.default_rng(0).random((100, count), dtype=np.float32)
    index = np.array([5, 99, 0, 5])
    numbers = row(float_array(table), index_array(index), count)
    assert np.array_equal(np.stack([np.array(number) for number in numbers], 1), table[index])


def test_least_power_of_two_is_not_below() -> None:
    assert [power_of_two(count) for count in range(1, 10)] == [1, 2, 4, 4, 8, 8, 8, 8, 16]
