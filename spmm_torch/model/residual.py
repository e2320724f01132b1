"""The residual function epsilon_k of each cluster: its storage and its interpolation."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from ..geometry.shapes import broadcast_shape
from .measured_pairs import MeasuredPairs

FLOAT16_MAX = 65504.0  # largest finite half


class Residual(nn.Module):
    """One signed function per cluster on V x L measured pairs [WDR11 §4.1].

    Values are stored as `code * scale`, where `code` fills the range of its type: float16 codes
    then keep a relative precision of 11 bits whatever the range of the data.

    Args:
        code: `[K, V, L, C]`, float16 or float32. Without clusters, K = 0, the residual is 0.
        scale: `[K]` float32.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
    """

    scale: Tensor

    def __init__(self, code: Tensor, scale: Tensor, light: Tensor, view: Tensor) -> None:
        super().__init__()
        self.code = nn.Parameter(code, requires_grad=False)
        self.register_buffer("scale", scale)
        self.pairs = MeasuredPairs.build(light, view)

    def with_codes(self, code: Tensor, scale: Tensor) -> Residual:
        """The same directions with the values of other clusters.

        Args:
            code: `[K', V, L, C]`.
            scale: `[K']`.
        """
        return Residual(code, scale, self.pairs.light.directions, self.pairs.view.directions)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Residual:
        """Moves the meshes with the module, without a change of their dtype."""
        super()._apply(fn, recurse)
        self.pairs = self.pairs.to(self.code.device)
        return self

    def forward(self, cluster: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """The residual `[..., C]` of clusters `[...]` at wi and wo `[..., 3]`, piecewise linear.

        Measured pairs return their stored value. Lights below the lowest measured one fade with
        their cosine. The residual is 0 where wi or wo is under the horizon.
        """
        shape = broadcast_shape(cluster.shape, wi.shape[:-1], wo.shape[:-1])
        wi, wo = (x.expand(*shape, 3).reshape(-1, 3) for x in (wi, wo))
        cluster = cluster.expand(shape).reshape(-1, 1)
        value = self.blend(cluster, torch.ones_like(cluster, dtype=wi.dtype), wi, wo)
        return value.view(*shape, -1)

    def blend(self, cluster: Tensor, weight: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Weighted sums `[Q, C]` of the residuals of clusters `[Q, M]`; see `forward`.

        A cluster that a query names more than once is looked up once.

        Args:
            cluster: `[Q, M]`.
            weight: of each of them, `[Q, M]`.
            wi, wo: directions `[Q, 3]`.
        """
        return self.at_pairs(cluster, weight, *self.pairs.around(wi, wo))

    def at_pairs(
        self, cluster: Tensor, weight: Tensor, pair: Tensor, pair_weight: Tensor
    ) -> Tensor:
        """`blend` given the pairs around each query and their weights, both `[Q, 9]`."""
        return blended(self.code, self.scale, cluster, weight, pair, pair_weight)


def blended(
    code: Tensor, scale: Tensor, cluster: Tensor, weight: Tensor, pair: Tensor, pair_weight: Tensor
) -> Tensor:
    """Weighted sums `[Q, C]` of the residuals of clusters, between measured pairs.

    Args:
        code, scale: of the residual, `[K, V, L, C]` and `[K]`.
        cluster, weight: clusters of each query and their weights, `[Q, M]`.
        pair, pair_weight: pairs around each query and their weights, `[Q, 9]`.
    """
    if not len(code):
        return pair_weight.new_zeros(len(pair), code.shape[-1])
    query, column, merged = _merged(cluster, weight)  # [E]
    cluster = cluster[query, column]
    table = code.flatten(1, 2)  # [K, V L, C]
    row = cluster[:, None] * table.shape[1] + pair.index_select(0, query)  # [E, 9]
    found = table.flatten(0, 1).index_select(0, row.flatten()).unflatten(0, row.shape)
    merged = merged * scale.to(pair_weight.dtype)[cluster]
    mixed = pair_weight.index_select(0, query) * merged[:, None]
    value = (found.to(pair_weight.dtype) * mixed[..., None]).sum(dim=1)  # [E, C]
    return value.new_zeros(len(pair), value.shape[1]).index_add(0, query, value)


def _merged(cluster: Tensor, weight: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(query `[E]`, column `[E]`, weight `[E]`) of clusters `[Q, M]`, each cluster of a query once.

    The first column of a cluster gets the weight of the later ones. Columns of weight 0 are left
    out, unless a gradient is needed.
    """
    columns, weights = cluster.unbind(1), list(weight.unbind(1))
    counts = []
    for later, column in enumerate(columns):
        alone = torch.ones_like(weight[:, 0])  # 0 once an earlier column has the weight
        for earlier in range(later):
            taken = (column == columns[earlier]) * alone
            weights[earlier] = weights[earlier] + taken * weights[later]
            alone = alone - taken
        counts.append(alone > 0.0)
    kept, whole = torch.stack(counts, dim=1), torch.stack(weights, dim=1)
    if not weight.requires_grad:
        kept = kept & (whole != 0.0)
    query, column = torch.nonzero(kept, as_tuple=True)
    return query, column, whole[query, column]


def encode_residual(values: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Residuals `[K, ...]` as codes of type `dtype` and one scale a cluster.

    Returns:
        (code `[K, ...]`, scale `[K]`), values ~ code * scale.
    """
    if dtype == torch.float32:
        return values.float(), torch.ones(len(values), device=values.device)
    largest = values.flatten(1).abs().amax(1).clamp(min=torch.finfo(torch.float32).tiny)
    # Half of the range: rounding must not reach infinity.
    scale = largest.float() / (0.5 * FLOAT16_MAX)
    return (values / scale.view(-1, *[1] * (values.dim() - 1))).to(dtype), scale


def decode_residual(code: Tensor, scale: Tensor) -> Tensor:
    """Values `[K, ...]` float32 of codes `[K, ...]` and scales `[K]`."""
    return code.float() * scale.view(-1, *[1] * (code.dim() - 1))
