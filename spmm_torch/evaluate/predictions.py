"""What a model predicts of a BTF, in blocks of bounded size.

Without a relief a picture shows at each texel that texel, and blocks are those of texels under all
pairs. With one it shows, at each texel, a mix of the texels that the view sees there, near or far:
blocks are then all texels under the pairs of one view.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data import BTF
from ..geometry.directions import direction_pairs
from ..model.lookup import SparseWeights
from ..model.relief import Relief
from ..model.spmm import SPMM
from ..runtime.memory import slices

# (cluster, pair) queries of the residual that are evaluated at once: about 100 MB.
BLOCK_QUERIES = 1 << 18


@dataclass(frozen=True)
class Predicted:
    """A BTF and its model at some texels and pairs.

    Attributes:
        texels, pairs: which ones.
        value: of the BTF, `[n, d, C]`.
        lobes: of the model without its residual, `[n, d, C]`.
        whole: of the model, `[n, d, C]`.
    """

    texels: slice
    pairs: slice
    value: Tensor
    lobes: Tensor
    whole: Tensor


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
        return cls._of(model, model.dictionary.eval_grid(light, view), wi, wo)

    @classmethod
    def of_pairs(cls, model: SPMM, wi: Tensor, wo: Tensor) -> Tabulated:
        """The tables for a list of pairs of lights and views, `[D, 3]` each."""
        wi, wo = wi.to(model.light), wo.to(model.view)
        return cls._of(model, model.dictionary.eval(wi[None], wo[None]), wi, wo)

    @classmethod
    def _of(cls, model: SPMM, rho: Tensor, wi: Tensor, wo: Tensor) -> Tabulated:
        """The tables, given values of lobes `[J, D]`."""
        clusters = torch.arange(model.cluster_count, device=wi.device)
        epsilon = [
            model.residual(part[:, None], wi[None], wo[None])
            for part in clusters.split(max(1, BLOCK_QUERIES // len(wi)))
        ]
        functions = None
        if model.components is not None:
            functions = model.components.functions(wi, wo).transpose(0, 1).contiguous()
        return cls(model, rho, torch.cat(epsilon), functions)

    def lobes(self, texels: slice, pairs: slice) -> Tensor:
        """The sum of the lobes of consecutive texels at consecutive pairs, `[n, d, C]`."""
        weights = self.model.sparse_weights
        offset = weights.offset[texels.start : texels.stop + 1]
        first, last = int(offset[0]), int(offset[-1])
        part = SparseWeights(offset - first, weights.index[first:last], weights.weight[first:last])
        return self.lobes_of(part, pairs)

    def lobes_of(self, entries: SparseWeights, pairs: slice) -> Tensor:
        """The sum of the lobes of the texels of some entries at consecutive pairs, `[n, d, C]`."""
        rho, offset = self.rho[:, pairs].contiguous(), entries.offset[:-1]
        planes = [
            F.embedding_bag(entries.index, rho, offset, mode="sum", per_sample_weights=channel)
            for channel in entries.weight.T.contiguous()
        ]
        return torch.stack(planes, dim=-1)

    def residual(self, texels: slice | Tensor, pairs: slice) -> Tensor:
        """The residual of texels at consecutive pairs, `[n, d, C]`."""
        total = self.epsilon[:, pairs][self.model.labels[texels]]
        if self.functions is None or self.model.components is None:
            return total
        coefficients = self.model.components.coefficients()[texels]
        functions = self.functions[:, pairs].flatten(1)
        return total + (coefficients @ functions).view(total.shape)


def predicted_blocks(
    model: SPMM, btf: BTF, block: int, progress: Callable[[int], object]
) -> Iterator[Predicted]:
    """All texels and pairs of a BTF beside what the model predicts.

    Args:
        model: on the device of the computation.
        btf: texels of the model, under any directions.
        block: values of one block.
        progress: called with the number of texels just done.
    """
    table = Tabulated.build(model, btf.light, btf.view)
    if model.relief is None:
        yield from _by_texel(table, btf, block, progress)
    else:
        yield from _by_view(table, model.relief, btf, block, progress)


def _by_texel(
    table: Tabulated, btf: BTF, block: int, progress: Callable[[int], object]
) -> Iterator[Predicted]:
    """Blocks of texels under all pairs."""
    pairs = slice(0, btf.pair_count)
    size = max(1, block // (btf.pair_count * btf.channels))
    for texels in slices(btf.texel_count, size):
        value = btf.texels(texels, table.rho.device)
        lobes = table.lobes(texels, pairs)
        yield Predicted(texels, pairs, value, lobes, lobes + table.residual(texels, pairs))
        progress(len(value))


def _by_view(
    table: Tabulated, relief: Relief, btf: BTF, block: int, progress: Callable[[int], object]
) -> Iterator[Predicted]:
    """Blocks of pairs of one view at all texels."""
    model, count, lights = table.model, btf.texel_count, len(btf.light)
    field = relief.field(model.height, model.width, model.view)
    drift = relief.drift_of(btf.view.to(model.view), model.view)  # [V, 2]
    texels = slice(0, count)
    for number, view in enumerate(btf.view.to(model.view)):
        pictures = btf.views(number, number + 1)[:, 0]  # [T, L, C]
        seen = field.footprint(view[None], drift[number, None])
        for some in slices(lights, max(1, block // (count * btf.channels))):
            pairs = slice(number * lights + some.start, number * lights + some.stop)
            lobes = seen.drawn(table.lobes(texels, pairs))
            whole = lobes + seen.drawn(table.residual(texels, pairs))
            value = pictures[:, some].to(lobes.device)
            yield Predicted(texels, pairs, value, lobes, whole)
        progress(count * (number + 1) // len(btf.view) - count * number // len(btf.view))
