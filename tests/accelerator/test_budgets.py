"""What a fit may ask of a GPU: operations that launch work, and waits of the host."""

from __future__ import annotations

import pytest

from spmm_torch import load_btf
from spmm_torch.benchmark.launches.tally import Tally
from spmm_torch.config.shipped import shipped
from spmm_torch.data import Selection, sample_path
from spmm_torch.fit import fit

# A part of the sample asks for as much as all of it: nothing is done texel by texel.
PART = Selection(crop=(0, 0, 16, 16))
LAUNCHES = {"smoke": 15_000, "default": 40_000}
WAITS = {"smoke": 320, "default": 400}


def asked(name: str, selection: Selection, tally: Tally) -> tuple[int, int]:
    """Launches and waits of a fit of the sample by settings that ship."""
    config = shipped(name, ("device=cuda",))
    fit(load_btf(sample_path(), selection=selection), config, render=False)
    return tally.launches.total(), tally.waits.total()


def test_a_part_of_the_sample_by_smoke(cuda: Tally) -> None:
    launches, waits = asked("smoke", PART, cuda)
    assert launches <= LAUNCHES["smoke"]
    assert waits <= WAITS["smoke"]


@pytest.mark.slow
@pytest.mark.parametrize("name", LAUNCHES)
def test_the_sample(name: str, cuda: Tally) -> None:
    launches, waits = asked(name, Selection(), cuda)
    assert launches <= LAUNCHES[name]
    assert waits <= WAITS[name]
