"""Squared errors of a saved model against a BTF, texel by texel and pair by pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..metrics import Totals
from ..model.spmm import SPMM
from .predictions import predicted_blocks

# Values of a block: 32 MB of float32, and about six times as much with temporaries.
BLOCK_VALUES = 1 << 23


@dataclass(frozen=True)
class SquaredErrors:
    """Sums of squares, float64 on the CPU.

    Attributes:
        energy, without_residual, with_residual, cluster_mean: of each direction pair `[D]`, over
            texels and channels; see `Totals`.
        texel_energy, texel_error: of the values of each texel `[T]`, and of the errors of the
            whole model, over fitted pairs and channels.
    """

    energy: Tensor
    without_residual: Tensor
    with_residual: Tensor
    cluster_mean: Tensor
    texel_energy: Tensor
    texel_error: Tensor

    def totals(self, pairs: Tensor) -> Totals:
        """The sums over some pairs, `[D]` bool."""
        parts = (self.energy, self.without_residual, self.with_residual, self.cluster_mean)
        return Totals(*(float(part[pairs].sum()) for part in parts))


@torch.no_grad()
def squared_errors(
    model: SPMM,
    btf: BTF,
    fitted: Tensor,
    progress: Callable[[int], object] = lambda count: None,
    block: int = BLOCK_VALUES,
) -> SquaredErrors:
    """Evaluates the model at every texel and pair of the BTF, block by block.

    Args:
        model: on the device of the computation.
        btf: texels of the model, under any directions.
        fitted: pairs that count for the sums of texels, `[D]` bool.
        progress: called with the number of texels just done.
        block: values of one block.
    """
    device = model.weight.device
    by_pair = torch.zeros(3, btf.pair_count, dtype=torch.float64, device=device)
    by_texel = torch.zeros(2, btf.texel_count, dtype=torch.float64, device=device)
    shape = (model.cluster_count, btf.pair_count, btf.channels)
    sums = torch.zeros(shape, dtype=torch.float64, device=device)
    counted = fitted.to(device, torch.float64)
    for part in predicted_blocks(model, btf, block, progress):
        # In float64: the errors of cluster means are a small difference of large energies, and
        # squares of values in another unit leave the range of float32.
        squares = [part.value.double().square().sum(-1)]  # [n, d]
        for predicted in (part.lobes, part.whole):
            squares.append((predicted - part.value).double().square().sum(-1))
        by_pair[:, part.pairs] += torch.stack([each.sum(0) for each in squares])
        weighted = [squares[number] @ counted[part.pairs] for number in (0, 2)]
        by_texel[:, part.texels] += torch.stack(weighted)
        mean = torch.zeros_like(sums[:, part.pairs], dtype=torch.float32)
        sums[:, part.pairs] += mean.index_add_(0, model.labels[part.texels], part.value)
    count = torch.bincount(model.labels, minlength=model.cluster_count)
    taken = (sums.square().sum(-1) / count.clamp(min=1)[:, None]).sum(0)  # [D]
    mean = (by_pair[0] - taken).clamp(min=0.0)
    energy, without_residual, with_residual = by_pair.cpu()
    texel_energy, texel_error = by_texel.cpu()
    return SquaredErrors(
        energy, without_residual, with_residual, mean.cpu(), texel_energy, texel_error
    )
