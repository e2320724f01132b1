"""Order of small whole numbers, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.lobes.ragged import (
    COUNTED,
    in_spans,
    ranges,
    run_starts,
    spans_within,
    stable_order,
)
from spmm_torch.runtime.memory import slices


@pytest.mark.parametrize("count", [1, 300, COUNTED, COUNTED + 1])
@pytest.mark.parametrize("dtype", [torch.int32, torch.int64])
def test_order_is_numpys_stable_one(count: int, dtype: torch.dtype) -> None:
    key = torch.randint(0, count, (5000,), generator=torch.Generator().manual_seed(0)).to(dtype)
    key[0] = count - 1
    expected = np.argsort(key.numpy(), kind="stable")
    assert np.array_equal(stable_order(key, count).numpy(), expected)


@given(st.lists(st.integers(0, 4), max_size=30), st.integers(1, 7))
def test_spans_are_the_runs_of_the_sorted_keys(keys: list[int], size: int) -> None:
    order, spans = in_spans(torch.tensor(keys, dtype=torch.long), 5)
    ordered = [keys[place] for place in order.tolist()]
    found = [value for value, own in spans for _ in ordered[own]]
    assert found == ordered == sorted(keys) and all(own.start < own.stop for _, own in spans)
    parts = [spans_within(spans, part) for part in slices(len(keys), size)]
    flat = [(value, own) for part in parts for value, own in part]
    assert [value for value, own in flat for _ in range(own.start, own.stop)] == ordered
    assert all(own.start >= 0 and own.stop <= size for _, own in flat)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=30))
def test_runs_begin_where_any_key_changes(pairs: list[tuple[int, int]]) -> None:
    first, second = (torch.tensor(column) for column in zip(*pairs, strict=True))
    expected = [k == 0 or pairs[k] != pairs[k - 1] for k in range(len(pairs))]
    assert run_starts(first, second).tolist() == expected


@given(st.lists(st.tuples(st.integers(-5, 50), st.integers(0, 6)), max_size=20))
def test_ranges_are_those_of_python(rows: list[tuple[int, int]]) -> None:
    start = torch.tensor([row[0] for row in rows], dtype=torch.long)
    count = torch.tensor([row[1] for row in rows], dtype=torch.long)
    owner, number = ranges(start, count)
    expected = [(k, n) for k, (first, size) in enumerate(rows) for n in range(first, first + size)]
    assert list(zip(owner.tolist(), number.tolist(), strict=True)) == expected
