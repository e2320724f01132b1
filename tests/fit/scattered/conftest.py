"""Lists of samples of known kinds."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from spmm_torch.data.pair_lists import PairList
from tests.planted.scattered import random_pairs


@pytest.fixture
def long_list() -> Callable[[bool], PairList]:
    """A list of a dark surface, with or without highlights that few pairs see."""

    def make(highlights: bool) -> PairList:
        wi, wo = random_pairs(1000, 7)
        values = torch.full((1, 1000, 3), 0.1)
        if highlights:
            values[:, ::100] = 100.0
        return PairList(torch.tensor([0]), wi, wo, values)

    return make
