"""No format can tell a missing pair from a black one, so that none is written with gaps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from spmm_torch.data.writers import WRITERS
from spmm_torch.errors import DataError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import texel_btf


@pytest.mark.parametrize("name", WRITERS)
def test_a_btf_with_gaps_is_refused_and_nothing_is_left(name: str, tmp_path: Path) -> None:
    directions = ring_directions(((0.0, 1), (45.0, 3)))
    missing = torch.zeros(4, 4, dtype=torch.bool)
    missing[1, 2] = True
    btf = replace(texel_btf(torch.rand(2, 16, 3), directions), missing=missing)
    writer = WRITERS[name]
    with pytest.raises(DataError, match="has no values at 1 of its 16 pairs of directions"):
        writer.write(tmp_path / f"out{writer.suffix}", btf, writer.settings(), None)
    assert not list(tmp_path.iterdir())
