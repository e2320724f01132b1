"""Importance sampling of wi for a given wo by one rotated lobe; `model.sampling` mixes lobes.

A lobe is sampled in its own frame, which is tilted. Directions under the horizon of the texel are
mirrored upward (z to -z), so a density p over the whole sphere becomes p(w) + p(mirrored w): it
integrates to 1 over the upper hemisphere and is never below p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..brdf.base import COS_EPS
from ..geometry.directions import frame_from_normal
from ..geometry.warp import square_to_uniform_hemisphere
from .batch import LobeBatch
from .pairs import PairRows, gather
from .ragged import groups
from .values import rotate

# Width under which a lobe is specular along at least one axis, see `Parameter.from_width`. A cosine
# lobe samples wider ones as well [WDR11 §5.1 leaves the value open].
SPECULAR_WIDTH = 0.5
# Least z of a sampled direction: the cosine lobe then gives it a density above 0.
LOWEST_Z = 1e-6
# Directions that average a lobe over light and view. The error of a few percent only moves samples
# from lobe to lobe.
INTENSITY_SAMPLES = 1024
# Samples drawn at once: about 100 MB.
BLOCK_SAMPLES = 1 << 20


@dataclass(frozen=True)
class LobeTable:
    """What sampling needs of J lobes.

    Attributes:
        model: index into `MODEL_NAMES`, `[J]`.
        kappa: parameters `[J, MAX_PARAMETERS]`.
        frame: rotations from texel to lobe coordinates `[J, 3, 3]`.
    """

    model: Tensor
    kappa: Tensor
    frame: Tensor

    @classmethod
    def build(cls, lobes: LobeBatch) -> LobeTable:
        """The table of `lobes`, without their autograd graph."""
        frame = frame_from_normal(lobes.normal.detach(), lobes.angle.detach())
        return cls(lobes.model, lobes.kappa.detach(), frame)

    def to(self, device: torch.device | str) -> LobeTable:
        """The same table on another device."""
        return LobeTable(self.model.to(device), self.kappa.to(device), self.frame.to(device))

    def sample(self, lobe: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """Directions wi `[N, 3]` of the upper hemisphere, each drawn from one lobe.

        Args:
            lobe: lobe of each direction, `[N]` long.
            wo: view directions `[N, 3]`.
            u: uniform numbers `[N, 3]` in [0, 1).
        """
        frame = self.frame.to(wo.dtype).index_select(0, lobe)  # [N, 3, 3]
        local_wo = _raised((frame @ wo[..., None])[..., 0])
        local = torch.empty_like(local_wo)
        for model, rows in groups(self.model.index_select(0, lobe), len(REGISTRY)):
            kappa, view = self._kappa(lobe, rows).to(wo.dtype), local_wo.index_select(0, rows)
            local[rows] = REGISTRY[model].sample(kappa, view, u.index_select(0, rows))
        wi = (local[:, None] @ frame)[:, 0]
        return torch.cat((wi[:, :2], wi[:, 2:].abs().clamp(min=LOWEST_Z)), dim=1)

    def pdf(self, lobe: Tensor, query: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` at wi, in 1/sr; 0 where wi is under the horizon of the texel.

        Args:
            lobe, query: of each pair, `[N]` long.
            wi, wo: directions of Q queries, `[Q, 3]`.

        Returns:
            `[N]`.
        """
        if not len(lobe):
            return wi.new_zeros(0)
        rows = PairRows.build(self.model, lobe, query)
        wi, wo = wi.T.contiguous(), wo.T.contiguous()  # [3, Q]
        parts = []
        for model, block in rows.blocks(self.model):
            owner, at = rows.lobe[block], rows.query[block]
            frame, kappa = (x.to(wo.dtype).index_select(0, owner) for x in (self.frame, self.kappa))
            parts.append(_density(model, kappa[:, None], frame, gather(wi, at), gather(wo, at)))
        return rows.spread(parts)

    def sees(self, lobe: Tensor, wo: Tensor) -> Tensor:
        """True `[N]` where wo `[N, 3]` is above the horizons of its lobe `[N]` and of the texel."""
        normal = self.frame[:, 2].to(wo.dtype).index_select(0, lobe)
        return ((normal * wo).sum(dim=-1) > 0.0) & (wo[:, 2] > 0.0)

    def _kappa(self, lobe: Tensor, rows: Tensor) -> Tensor:
        """Parameters `[R, MAX_PARAMETERS]` of the entries at `rows [R]`."""
        return self.kappa.index_select(0, lobe.index_select(0, rows))


def _density(model: int, kappa: Tensor, frame: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """`LobeTable.pdf` of rows: kappa `[G, 1, P]`, frame `[G, 3, 3]`, wi and wo `[G, S, 3]`."""
    local_wi, local_wo = rotate(frame, wi), _raised(rotate(frame, wo))
    mirrored = rotate(frame * frame.new_tensor((1.0, 1.0, -1.0)), wi)
    upper = REGISTRY[model].pdf(kappa, local_wi, local_wo)
    lower = REGISTRY[model].pdf(kappa, mirrored, local_wo)
    return (upper + lower) * wi[..., 2].clamp(0.0, 1.0).ceil()


def _raised(w: Tensor) -> Tensor:
    """Unit views `[..., 3]` in the frame of a lobe, mirrored and lifted above its horizon.

    At the horizon float32 cannot tell the half vector; BRDFs hardly change there.
    """
    x, y, z = w.unbind(-1)
    z = z.abs().clamp(min=COS_EPS)
    length = torch.sqrt(x * x + y * y + z * z)
    return torch.stack((x / length, y / length, z / length)).movedim(0, -1)


def specular_mask(lobes: LobeBatch, width: float = SPECULAR_WIDTH) -> Tensor:
    """True `[J]` for specular lobes, those narrower than `width` [WDR11 §5.1]."""
    mask = torch.zeros(len(lobes), dtype=torch.bool, device=lobes.kappa.device)
    for model, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.from_width is not None:
                limit = row.from_width(width)
                sign = 1.0 if row.from_width(0.5 * width) > limit else -1.0
                mask[rows] |= sign * lobes.kappa[rows, column] > sign * limit
    return mask


def lobe_intensity(lobes: LobeBatch, table: LobeTable, samples: int = INTENSITY_SAMPLES) -> Tensor:
    """Mean of each rho_j over light and view, `[J]` in 1/sr: the integral of [WDR11 Eq. 9].

    The integrand is rho_j of Eq. 3 rather than f_j, because rho_j is what samples are drawn for;
    its cosine keeps grazing light from ruling the mean. The directions are those of a fixed Sobol
    sequence.

    Args:
        lobes: J lobes.
        table: of the same lobes.
        samples: directions of each lobe; a power of two fills space most evenly.
    """
    # Sobol points are the lower corners of cells: half a cell more gives their centres.
    points = torch.quasirandom.SobolEngine(5).draw(samples).to(table.kappa) + 0.5 / samples
    wo, u = square_to_uniform_hemisphere(points[:, :2]), points[:, 2:]
    parts = []
    for rows in torch.arange(len(lobes), device=wo.device).split(max(1, BLOCK_SAMPLES // samples)):
        lobe = rows.repeat_interleave(samples)
        view, choice = wo.repeat(len(rows), 1), u.repeat(len(rows), 1)
        wi = table.sample(lobe, view, choice)
        query = torch.arange(len(lobe), device=wi.device)
        density = table.pdf(lobe, query, wi, view).clamp(min=torch.finfo(wi.dtype).tiny)
        rho = lobes[rows].detach().eval(wi.view(len(rows), samples, 3), wo[None])
        parts.append((rho / density.view_as(rho)).mean(dim=1))
    return torch.cat(parts or [wo.new_zeros(0)]) / (2.0 * math.pi)
