"""Blocks of texels against the lists of their four texels."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.geometry.directions import texel_at
from spmm_torch.model import lookup
from spmm_torch.model.lookup import SparseWeights, TexelBlocks, blocks_met

HEIGHT, WIDTH, LOBES = 3, 4, 9
COUNTS = (0, 1, 8, 2, 3, 0, 1, 2, 4, 1, 1, 0)


def texture() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(offset, index, weight) of a texture whose texels list their lobes in any order."""
    generator = torch.Generator().manual_seed(0)
    index = [torch.randperm(LOBES, generator=generator)[:count] for count in COUNTS]
    weight = torch.rand(sum(COUNTS), 3, generator=generator)
    return torch.tensor([0, *COUNTS]).cumsum(0), torch.cat(index), weight


def dense(texel: int) -> torch.Tensor:
    """Weights `[LOBES, 3]` of one texel."""
    offset, index, weight = texture()
    entries = slice(int(offset[texel]), int(offset[texel + 1]))
    return torch.zeros(LOBES, 3).index_add(0, index[entries], weight[entries])


@pytest.mark.parametrize("counted", [lookup.COUNTED, 1])
def test_blocks_hold_the_weights_of_their_texels(
    counted: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lookup, "COUNTED", counted)
    uv = torch.rand(40, 2, generator=torch.Generator().manual_seed(1))
    texel, _ = texel_at(uv, HEIGHT, WIDTH)
    block, corners = blocks_met(texel, HEIGHT * WIDTH)
    assert torch.equal(corners[block], texel)
    blocks = TexelBlocks.build(
        corners, torch.ones_like(corners, dtype=torch.bool), SparseWeights(*texture())
    )
    assert int(blocks.count.sum()) == len(blocks.lobe) == len(blocks.weight)
    for number, four in enumerate(corners.tolist()):
        entries = slice(int(blocks.start[number]), int(blocks.start[number] + blocks.count[number]))
        lobe = blocks.lobe[entries]
        assert len(torch.unique(lobe)) == len(lobe)
        found = torch.zeros(LOBES, 4, 3)
        found[lobe] = blocks.weight[entries]
        torch.testing.assert_close(found, torch.stack([dense(t) for t in four], dim=1))


def test_texels_that_do_not_count_bring_no_lobes() -> None:
    corners = torch.tensor([[1, 2, 3, 4], [2, 2, 2, 2]])
    counts = torch.tensor([[True, False, False, False], [False] * 4])
    blocks = TexelBlocks.build(corners, counts, SparseWeights(*texture()))
    assert blocks.count.tolist() == [COUNTS[1], 0]
    assert bool((blocks.weight[:, 1:] == 0.0).all())


def test_a_lobe_listed_twice_adds_up() -> None:
    offset, index, weight = torch.tensor([0, 2]), torch.tensor([5, 5]), torch.rand(2, 3)
    corners = torch.zeros(1, 4, dtype=torch.long)
    counts = torch.tensor([[True, False, False, False]])
    blocks = TexelBlocks.build(corners, counts, SparseWeights(offset, index, weight))
    assert blocks.lobe.tolist() == [5]
    torch.testing.assert_close(blocks.weight[0, 0], weight.sum(0))
