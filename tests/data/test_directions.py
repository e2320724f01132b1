"""Checks of measured directions leave what the caller holds as it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from spmm_torch import BTF
from spmm_torch.data.directions import checked_directions, unit_directions
from spmm_torch.data.scattered_btf import ScatteredBTF

# The second one lies under the horizon by as much as rounding makes of it, and is raised.
LOW = np.array([[0.0, 0.0, 1.0], [math.sqrt(1.0 - 4e-8), 0.0, -2e-4]])


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_directions_are_raised_to_the_horizon_in_a_copy(kind: type[np.floating]) -> None:
    given = LOW.astype(kind)
    kept = given.copy()
    for check in (checked_directions, unit_directions):
        found = check(torch.from_numpy(given), "a test")
        torch.testing.assert_close(found, torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
        assert np.array_equal(given, kept)


def test_a_btf_of_arrays_leaves_them_as_they_are() -> None:
    light, view = LOW.copy(), LOW.copy()
    BTF.from_values(np.ones((2, 2, 1, 1, 3), np.float32), view, light)
    ScatteredBTF.from_samples(light, view, np.ones((1, 2, 3), np.float32))
    assert np.array_equal(light, LOW)
    assert np.array_equal(view, LOW)
