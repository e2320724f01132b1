"""Choice of the best start, and the count of failed ones."""

from __future__ import annotations

import torch

from spmm_torch.solvers.multistart import StartTally, best_start


def test_takes_the_least_value_and_never_nan() -> None:
    value = torch.tensor([[3.0, torch.nan], [1.0, 5.0], [2.0, torch.inf]])
    assert best_start(value).tolist() == [1, 1]


def test_tally_counts_each_failure_once() -> None:
    tally = StartTally()
    failed = torch.tensor([True, False, False])
    tally.add(failed, torch.tensor([True, True, False]))
    tally.add(~failed, torch.zeros(3, dtype=torch.bool))
    assert tally.to_tensor().tolist() == [6, 3, 1]
