"""Choice of the best start."""

from __future__ import annotations

import torch

from spmm_torch.solvers.multistart import best_of


def test_takes_the_least_value_and_never_nan() -> None:
    value = torch.tensor([[3.0, 1.0, 2.0], [torch.nan, 5.0, torch.inf]])
    x = torch.arange(12.0).reshape(2, 3, 2)
    best, least, which = best_of(value, x)
    assert which.tolist() == [1, 1]
    assert least.tolist() == [1.0, 5.0]
    assert best.tolist() == [[2.0, 3.0], [8.0, 9.0]]
