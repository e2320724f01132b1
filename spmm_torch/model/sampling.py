"""Importance sampling of a texel's whole mixture of lobes [WDR11 §6].

A texel has a specular group, from which lobe j is taken with probability gamma_j
[WDR11 Eq. 8, 9], and one cosine lobe for everything else: the other lobes and the residual.
Bilinear lookups mix the four texels by their shares. Lobes whose horizon hides wo are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from ..lobes.batch import LobeBatch
from ..lobes.sampling import LobeTable, lobe_intensity, specular_mask

# The cosine lobe keeps at least this much of the samples: every direction can be reached, and what
# the specular group misses is weighted by ten times its cosine-sampled weight at the most.
MIN_COSINE_SHARE = 0.1
CODE_MAX = 255  # probabilities are stored in one byte
# (query, lobe) entries that are worked on at once: about 50 MB.
BLOCK_ENTRIES = 1 << 18


@dataclass(frozen=True)
class SamplingData:
    """What is precomputed to sample T texels; probabilities are whole multiples of 1 / CODE_MAX.

    Attributes:
        table: the dictionary's J lobes.
        offset: where each texel's specular entries start, `[T + 1]` int32.
        index: lobe of each specular entry, `[S]` int32.
        gamma: probabilities within the texel [WDR11 Eq. 9], `[S]` uint8, in parts of their sum.
        group: probability of the specular group of each texel, `[T]` uint8.
        longest: most specular entries of a texel.
    """

    table: LobeTable
    offset: Tensor
    index: Tensor
    gamma: Tensor
    group: Tensor
    longest: int

    @classmethod
    def build(
        cls, lobes: LobeBatch, offset: Tensor, index: Tensor, weight: Tensor, rest: Tensor
    ) -> SamplingData:
        """Precomputes from a model's parts, which it does not change.

        Args:
            lobes: the dictionary.
            offset, index, weight: entries of all texels: `[T + 1]`, `[N]`, `[N, C]`.
            rest: intensity of what no lobe explains, `[T]`; see `residual_intensity`.
        """
        table = LobeTable.build(lobes)
        intensity = weight.detach().mean(dim=1).clamp(min=0.0)  # [N]
        intensity = intensity * lobe_intensity(lobes, table)[index]
        count = offset[1:] - offset[:-1]
        texel = torch.repeat_interleave(count)  # [N]
        kept = specular_mask(lobes)[index] & (intensity > 0.0)
        zero = torch.zeros_like(rest)
        specular = zero.index_add(0, texel[kept], intensity[kept])
        other = rest.index_add(0, texel[~kept], intensity[~kept])
        gamma = intensity[kept] / specular[texel[kept]]
        ratio = torch.where(specular > 0.0, specular / (specular + other), zero)
        share = torch.ceil(CODE_MAX * ratio).clamp(max=int(CODE_MAX * (1.0 - MIN_COSINE_SHARE)))
        lengths = torch.zeros_like(offset).index_add(
            0, texel[kept] + 1, torch.ones_like(index[kept])
        )
        return cls(
            table,
            lengths.cumsum(0).int(),
            index[kept].int(),
            torch.ceil(CODE_MAX * gamma).clamp(max=CODE_MAX).to(torch.uint8),
            share.to(torch.uint8),
            int(lengths.max()),
        )

    def bytes(self) -> int:
        """Bytes beyond the model's own: gamma and group. The model tells all else at once."""
        return sum(part.numel() * part.element_size() for part in (self.gamma, self.group))

    def to(self, device: torch.device | str) -> SamplingData:
        """The same data on another device."""
        parts = (self.offset, self.index, self.gamma, self.group)
        return SamplingData(
            self.table.to(device), *(part.to(device) for part in parts), self.longest
        )


def sample(
    data: SamplingData,
    texel: Tensor,
    share: Tensor,
    wo: Tensor,
    u: Tensor,
    block: int = BLOCK_ENTRIES,
) -> tuple[Tensor, Tensor]:
    """Light directions for views of mixed texels.

    Args:
        texel: texels of each query `[Q, M]`, long.
        share: their shares `[Q, M]`, which sum to 1.
        wo: unit view directions `[Q, 3]`.
        u: `[Q, 3]` in [0, 1).
        block: entries of one block.

    Returns:
        (wi `[Q, 3]` in the upper hemisphere, its density `[Q]` as of `pdf`).
    """
    blocks = zip(*_split(data, block, texel, share, wo, u), strict=True)
    parts = [_sample_block(data, *block) for block in blocks]
    return torch.cat([wi for wi, _ in parts]), torch.cat([density for _, density in parts])


def pdf(
    data: SamplingData,
    texel: Tensor,
    share: Tensor,
    wi: Tensor,
    wo: Tensor,
    block: int = BLOCK_ENTRIES,
) -> Tensor:
    """Density of `sample` at wi `[Q, 3]`, per solid angle: `[Q]`.

    It integrates to 1 over the upper hemisphere, is above 0 all over it, and 0 under the horizon.
    """
    blocks = zip(*_split(data, block, texel, share, wo, wi), strict=True)
    parts = [
        _density(data, _mixture(data, texel, share, wo), wi, wo) for texel, share, wo, wi in blocks
    ]
    return torch.cat(parts)


@dataclass(frozen=True)
class _Mixture:
    """Lobes that Q queries may be sampled from, in the order of the queries.

    Attributes:
        query: whom each entry belongs to, `[N]`.
        lobe: `[N]` long.
        mass: its probability, `[N]`.
        cosine: probability of the cosine lobe, `[Q]`.
    """

    query: Tensor
    lobe: Tensor
    mass: Tensor
    cosine: Tensor


def _split(
    data: SamplingData, block: int, texel: Tensor, *others: Tensor
) -> list[tuple[Tensor, ...]]:
    """Each tensor `[Q, ...]` in blocks of `block` entries."""
    size = max(1, block // max(1, data.longest * texel.shape[1]))
    return [part.split(size) for part in (texel, *others)]


def _mixture(data: SamplingData, texel: Tensor, share: Tensor, wo: Tensor) -> _Mixture:
    """The mixture that stands for each query: texel and share `[Q, M]`, wo `[Q, 3]`."""
    flat, share = texel.flatten(), share.flatten().to(wo.dtype)  # [Q M]
    start = data.offset[flat].long()
    count = (data.offset[flat + 1] - start) * (share != 0.0)
    corner = torch.repeat_interleave(count)  # [N], position in `flat`
    first = torch.cumsum(count, 0) - count
    entry = torch.arange(len(corner), device=corner.device) + (start - first).index_select(
        0, corner
    )
    query = torch.div(corner, texel.shape[1], rounding_mode="floor")
    lobe = data.index.index_select(0, entry).long()
    seen = data.gamma.index_select(0, entry).to(wo.dtype) * data.table.sees(
        lobe, wo.index_select(0, query)
    )  # [N]
    total = torch.zeros_like(share).index_add(0, corner, seen)  # [Q M]
    group = share * (data.group[flat].to(wo.dtype) / CODE_MAX) * (total > 0.0)
    mass = seen * (group / total.clamp(min=1.0)).index_select(0, corner)
    return _Mixture(query, lobe, mass, 1.0 - group.view(texel.shape).sum(dim=1))


def _sample_block(
    data: SamplingData, texel: Tensor, share: Tensor, wo: Tensor, u: Tensor
) -> tuple[Tensor, Tensor]:
    """`sample` of Q queries."""
    mixture = _mixture(data, texel, share, wo)
    rows, entry, left = _pick(mixture, u[:, 0])
    wi = square_to_cosine_hemisphere(u[:, 1:])
    choice = torch.cat((left[:, None], u[rows, 1:]), dim=1)
    wi[rows] = data.table.sample(mixture.lobe[entry], wo[rows], choice)
    return wi, _density(data, mixture, wi, wo)


def _pick(mixture: _Mixture, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The lobe that `u [Q]` chooses, for the queries where it is not the cosine lobe.

    Sums run over all queries at once, so in float64, in which a block's are exact enough.

    Returns:
        (rows `[R]` among the queries, entry `[R]`, what is left of u `[R]`, uniform in [0, 1)).
    """
    end = torch.searchsorted(mixture.query, torch.arange(len(u), device=u.device), right=True)
    reach = torch.cat((mixture.mass.new_zeros(1), mixture.mass)).double().cumsum(0)  # [N + 1]
    begin = torch.cat((end.new_zeros(1), end[:-1]))
    target = reach[begin] + u
    entry = torch.searchsorted(reach, target, right=True) - 1  # reach[entry] <= target
    rows = torch.nonzero(entry < end).squeeze(-1)
    entry = entry[rows]
    left = (target[rows] - reach[entry]) / (reach[entry + 1] - reach[entry])
    return rows, entry, left.to(u.dtype).clamp(0.0, 1.0 - torch.finfo(u.dtype).eps)


def _density(data: SamplingData, mixture: _Mixture, wi: Tensor, wo: Tensor) -> Tensor:
    """`pdf` of Q queries, wi and wo `[Q, 3]`."""
    density = mixture.mass * data.table.pdf(mixture.lobe, mixture.query, wi, wo)
    cosine = mixture.cosine * square_to_cosine_hemisphere_pdf(wi)
    return cosine.index_add(0, mixture.query, density)


def residual_intensity(code: Tensor, scale: Tensor) -> Tensor:
    """Mean size of each cluster's residual over measured pairs and channels, `[K]` in 1/sr.

    Args:
        code: `[K, V, L, C]`.
        scale: `[K]`; values are code * scale.
    """
    sizes = [part.float().abs().mean() for part in code.detach()]
    return torch.stack(sizes).to(scale) * scale
