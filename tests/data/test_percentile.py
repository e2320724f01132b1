"""The exact percentile against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spmm_torch.data.percentile import percentile

VALUES = arrays(
    np.float32,
    st.integers(1, 200),
    elements=st.floats(0, 1e6, width=32) | st.sampled_from([0.0, -0.0, 0.5, 1.0]),
)


@settings(max_examples=40, deadline=None)
@given(VALUES, st.sampled_from([0.001, 0.5, 0.9, 0.999, 1.0]), st.sampled_from([64, 150, 200]))
def test_equals_numpy_whatever_the_chunk(values: np.ndarray, fraction: float, chunk: int) -> None:
    found = percentile(torch.from_numpy(values).split(chunk), values.size, fraction)
    # The rank is taken here because NumPy rounds fraction * n in its own way.
    rank = max(int(np.ceil(fraction * values.size)), 1)
    assert found == np.sort(values)[rank - 1]


def test_many_values() -> None:
    values = torch.rand(10**6, generator=torch.Generator().manual_seed(0)) * 30
    expected = np.percentile(values.numpy(), 99.9, method="inverted_cdf")
    assert percentile(values.split(300_000), len(values), 0.999) == pytest.approx(float(expected))


def test_high_values_at_the_end_and_many_alike() -> None:
    """The largest values so far are no guess at those to come, and the bound is one of many."""
    generator = torch.Generator().manual_seed(1)
    values = (torch.rand(10**6, generator=generator) * 50).round().sort().values
    for order in (values, values.flip(0)):
        found = percentile(order.split(90_000), len(values), 0.999)
        assert found == float(values[999_000 - 1])


def test_negative_values_count_as_zero() -> None:
    assert percentile([torch.tensor([-3.0, -2.0, -1.0])], 3, 0.999) == 0.0
