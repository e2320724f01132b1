"""A run and its input, matched by their directions."""

from __future__ import annotations

import torch

from spmm_torch.evaluate import source
from tests.largest_tensor import LargestTensor
from tests.planted.directions import random_directions


def test_directions_of_the_fit_are_found_among_thousands_without_a_table_of_all_pairs() -> None:
    directions = random_directions(3000, seed=1)
    fitted = directions[::2].clone() + 1e-6
    with LargestTensor() as largest:
        seen = source._seen(directions, fitted)
    assert seen.tolist() == [True, False] * 1500
    assert largest.numel <= directions.numel()
    assert not source._seen(directions, torch.tensor([[0.0, 0.0, -1.0]]).double()).any()
