"""Squared errors of a saved model against a BTF, texel by texel and pair by pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data import BTF
from ..geometry.directions import direction_pairs
from ..metrics import Totals
from ..model.spmm import SPMM
from ..runtime.memory import slices

# Values of a block of texels: 32 MB of float32, and about six times as much with temporaries.
BLOCK_VALUES = 1 << 23
# (cluster, pair) queries of the residual that are evaluated at once: about 100 MB.
BLOCK_QUERIES = 1 << 18


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


@dataclass(frozen=True)
class Tabulated:
    """A model at fixed direction pairs.

    Attributes:
        model: on the device of the tables.
        rho: values of lobes, `[J, D]`.
        epsilon: the residual of the clusters, `[K, D, C]`.
        functions: those of the components, `[R, D, C]`; None for none.
    """

    model: SPMM
    rho: Tensor
    epsilon: Tensor
    functions: Tensor | None

    @classmethod
    def build(cls, model: SPMM, light: Tensor, view: Tensor) -> Tabulated:
        """The tables for lights `[L, 3]` and views `[V, 3]`."""
        light, view = light.to(model.light), view.to(model.view)
        wi, wo = direction_pairs(light, view)
        clusters = torch.arange(model.cluster_count, device=wi.device)
        epsilon = [
            model.residual(part[:, None], wi[None], wo[None])
            for part in clusters.split(max(1, BLOCK_QUERIES // len(wi)))
        ]
        functions = None
        if model.components is not None:
            functions = model.components.functions(wi, wo).transpose(0, 1).contiguous()
        return cls(model, model.dictionary.eval_grid(light, view), torch.cat(epsilon), functions)

    def residual(self, texels: slice) -> Tensor:
        """The residual of consecutive texels, `[n, D, C]`."""
        total = self.epsilon[self.model.labels[texels]]
        if self.functions is None or self.model.components is None:
            return total
        coefficients = self.model.components.coefficients()[texels]
        return total + (coefficients @ self.functions.flatten(1)).view(total.shape)

    def lobes(self, texels: slice) -> Tensor:
        """The sum of the lobes of consecutive texels, `[n, D, C]`."""
        weights = self.model.sparse_weights
        offset = weights.offset[texels.start : texels.stop + 1]
        first, last = int(offset[0]), int(offset[-1])
        index, weight = weights.index[first:last], weights.weight[first:last]
        planes = [
            F.embedding_bag(
                index, self.rho, offset[:-1] - first, mode="sum", per_sample_weights=channel
            )
            for channel in weight.T.contiguous()
        ]
        return torch.stack(planes, dim=-1)


@torch.no_grad()
def squared_errors(
    model: SPMM,
    btf: BTF,
    fitted: Tensor,
    progress: Callable[[int], object] = lambda count: None,
    block: int = BLOCK_VALUES,
) -> SquaredErrors:
    """Evaluates the model at every texel and pair of the BTF, one block of texels at a time.

    Args:
        model: on the device of the computation.
        btf: texels of the model, under any directions.
        fitted: pairs that count for the sums of texels, `[D]` bool.
        progress: called with the number of texels just done.
        block: values of one block.
    """
    device = model.weight.device
    table = Tabulated.build(model, btf.light, btf.view)
    by_pair = torch.zeros(3, btf.pair_count, dtype=torch.float64, device=device)
    by_texel = torch.zeros(2, btf.texel_count, dtype=torch.float64, device=device)
    sums = torch.zeros_like(table.epsilon, dtype=torch.float64)  # [K, D, C]
    counted = fitted.to(device, torch.float64)
    size = max(1, block // (btf.pair_count * btf.channels))
    for texels in slices(btf.texel_count, size):
        value = btf.texels(texels, device)  # [n, D, C]
        label = model.labels[texels]
        lobes = table.lobes(texels)
        # In float64: the errors of cluster means are a small difference of large energies.
        squares = [value.double().square().sum(-1)]  # [n, D]
        for error in (lobes - value, lobes + table.residual(texels) - value):
            squares.append(error.square().sum(-1).double())
        by_pair += torch.stack([part.sum(0) for part in squares])
        by_texel[:, texels] = torch.stack([squares[0] @ counted, squares[2] @ counted])
        sums += torch.zeros_like(table.epsilon).index_add_(0, label, value)
        progress(len(value))
    count = torch.bincount(model.labels, minlength=model.cluster_count)
    taken = (sums.square().sum(-1) / count.clamp(min=1)[:, None]).sum(0)  # [D]
    mean = (by_pair[0] - taken).clamp(min=0.0)
    energy, without_residual, with_residual = by_pair.cpu()
    texel_energy, texel_error = by_texel.cpu()
    return SquaredErrors(
        energy, without_residual, with_residual, mean.cpu(), texel_energy, texel_error
    )
