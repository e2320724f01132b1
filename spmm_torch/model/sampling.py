"""Importance sampling of a texel's whole mixture of lobes [WDR11 §6].

A sample comes from the specular group of a texel, lobe j with probability gamma_j [WDR11 Eq. 8, 9],
or from one cosine lobe, which stands for the other lobes and the residual. Bilinear lookups mix
four texels by their weights. Lobes whose horizon hides wo are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from ..lobes.batch import LobeBatch
from ..lobes.sampling import LobeTable, lobe_intensity, specular_mask

# Least probability of the cosine lobe: every direction can be sampled, with at most ten times the
# weight that it would have from the cosine lobe alone.
MIN_COSINE_PROBABILITY = 0.1
# Width of lobes up to which they are sampled: a cosine lobe samples wider ones with the same noise,
# and its samples take a third of the time. Specular lobes of edits are up to twice as wide.
SAMPLED_WIDTH = 0.25
CODE_MAX = 255  # largest code of a probability, which has one byte
# (query, lobe) entries that are sampled at once: about 50 MB.
SAMPLED_ENTRIES = 1 << 18


@dataclass(frozen=True)
class SamplingData:
    """What sampling T texels needs; probabilities are whole multiples of 1 / CODE_MAX.

    Attributes:
        table: the dictionary's J lobes.
        offset: where each texel's specular entries start, `[T + 1]` int32.
        index: lobe of each specular entry, `[S]` int32.
        gamma: probability of each entry within its texel, relative to their sum, `[S]` uint8
            [WDR11 Eq. 9].
        group: probability of the specular group of each texel, `[T]` uint8.
        longest: largest number of specular entries of a texel.
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
        """What sampling needs of a model, which stays as it is.

        Args:
            lobes: the dictionary.
            offset, index, weight: entries of all texels: `[T + 1]`, `[N]`, `[N, C]`.
            rest: intensity of the residual, `[T]`; see `residual_intensity`.
        """
        table = LobeTable.build(lobes)
        intensity = weight.detach().mean(dim=1).clamp(min=0.0)  # [N]
        intensity = intensity * lobe_intensity(lobes, table)[index]
        count = offset[1:] - offset[:-1]
        texel = torch.repeat_interleave(count)  # [N]
        kept = specular_mask(lobes, SAMPLED_WIDTH)[index] & (intensity > 0.0)
        zero = torch.zeros_like(rest)
        specular = zero.index_add(0, texel[kept], intensity[kept])
        other = rest.index_add(0, texel[~kept], intensity[~kept])
        gamma = intensity[kept] / specular[texel[kept]]  # Eq. (9)
        ratio = torch.where(specular > 0.0, specular / (specular + other), zero)
        most = int(CODE_MAX * (1.0 - MIN_COSINE_PROBABILITY))
        group = torch.ceil(CODE_MAX * ratio).clamp(max=most)
        lengths = torch.zeros_like(offset).index_add(
            0, texel[kept] + 1, torch.ones_like(index[kept])
        )
        return cls(
            table,
            lengths.cumsum(0).int(),
            index[kept].int(),
            torch.ceil(CODE_MAX * gamma).clamp(max=CODE_MAX).to(torch.uint8),
            group.to(torch.uint8),
            int(lengths.max()),
        )

    def bytes(self) -> int:
        """Bytes of gamma and group; all else follows from the model."""
        return sum(part.numel() * part.element_size() for part in (self.gamma, self.group))

    def to(self, device: torch.device | str) -> SamplingData:
        """The same data on another device."""
        return SamplingData(
            self.table.to(device),
            self.offset.to(device),
            self.index.to(device),
            self.gamma.to(device),
            self.group.to(device),
            self.longest,
        )


def sample(
    data: SamplingData,
    texel: Tensor,
    weight: Tensor,
    wo: Tensor,
    u: Tensor,
    block: int = SAMPLED_ENTRIES,
) -> tuple[Tensor, Tensor]:
    """Light directions drawn from mixtures of texels [WDR11 §6].

    Args:
        data: of the model.
        texel: texels of each query `[Q, M]`, long.
        weight: of each of them, `[Q, M]`; they sum to 1.
        wo: unit view directions `[Q, 3]`.
        u: uniform numbers `[Q, 3]` in [0, 1).
        block: entries of one block.

    Returns:
        (wi `[Q, 3]` in the upper hemisphere, its density `[Q]`; see `pdf`).
    """
    blocks = zip(*_split(data, block, texel, weight, wo, u), strict=True)
    parts = [_sample_block(data, *block) for block in blocks]
    return torch.cat([wi for wi, _ in parts]), torch.cat([density for _, density in parts])


def pdf(
    data: SamplingData,
    texel: Tensor,
    weight: Tensor,
    wi: Tensor,
    wo: Tensor,
    block: int = SAMPLED_ENTRIES,
) -> Tensor:
    """Density of `sample` at wi `[Q, 3]`, in 1/sr: `[Q]`.

    It integrates to 1 over the upper hemisphere, where it is above 0, and is 0 under the horizon.

    Args:
        data, texel, weight, wo, block: as in `sample`.
        wi: unit light directions `[Q, 3]`.
    """
    parts = []
    for some, own, view, light in zip(*_split(data, block, texel, weight, wo, wi), strict=True):
        parts.append(_density(data, _mixture(data, some, own, view), light, view))
    return torch.cat(parts)


@dataclass(frozen=True)
class _Mixture:
    """Specular lobes and the cosine lobe of Q queries; entries are in the order of the queries.

    Attributes:
        query: query of each entry, `[N]`.
        lobe: lobe of each entry, `[N]` long.
        mass: probability of each entry, `[N]`.
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


def _mixture(data: SamplingData, texel: Tensor, weight: Tensor, wo: Tensor) -> _Mixture:
    """The mixture of each query: texel and weight `[Q, M]`, wo `[Q, 3]`."""
    flat, weight = texel.flatten(), weight.flatten().to(wo.dtype)  # [Q M]
    start = data.offset[flat].long()
    count = (data.offset[flat + 1] - start) * (weight != 0.0)
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
    total = torch.zeros_like(weight).index_add(0, corner, seen)  # [Q M]
    group = weight * (data.group[flat].to(wo.dtype) / CODE_MAX) * (total > 0.0)
    mass = seen * (group / total.clamp(min=1.0)).index_select(0, corner)
    return _Mixture(query, lobe, mass, 1.0 - group.view(texel.shape).sum(dim=1))


def _sample_block(
    data: SamplingData, texel: Tensor, weight: Tensor, wo: Tensor, u: Tensor
) -> tuple[Tensor, Tensor]:
    """`sample` of one block of queries."""
    mixture = _mixture(data, texel, weight, wo)
    rows, entry, left = _pick(mixture, u[:, 0])
    wi = square_to_cosine_hemisphere(u[:, 1:])
    choice = torch.cat((left[:, None], u[rows, 1:]), dim=1)
    wi[rows] = data.table.sample(mixture.lobe[entry], wo[rows], choice)
    return wi, _density(data, mixture, wi, wo)


def _pick(mixture: _Mixture, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The specular lobe that `u [Q]` chooses; none for queries that get the cosine lobe.

    The cumulative sum runs over all queries, so it needs float64.

    Returns:
        (queries `[R]` that get a specular lobe, its entry `[R]`, u `[R]` stretched to [0, 1)).
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
    """`pdf` of Q queries `[Q]`, given their mixture, wi and wo `[Q, 3]`."""
    density = mixture.mass * data.table.pdf(mixture.lobe, mixture.query, wi, wo)
    cosine = mixture.cosine * square_to_cosine_hemisphere_pdf(wi)
    return cosine.index_add(0, mixture.query, density)


def residual_intensity(code: Tensor, scale: Tensor) -> Tensor:
    """Mean |epsilon_k| over measured pairs and channels, `[K]` in 1/sr.

    Args:
        code: `[K, V, L, C]`.
        scale: `[K]`; values are code * scale.
    """
    sizes = [part.float().abs().mean() for part in code.detach()]
    return torch.stack(sizes).to(scale) * scale
