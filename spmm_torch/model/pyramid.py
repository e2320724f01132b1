"""A model at several resolutions, for lookups of areas: trilinear, as mip maps are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from ..errors import OutputError
from ..geometry.shapes import broadcast_shape
from ..runtime.atomic import output_errors
from .dense import traced
from .queries import check_queries
from .spmm import SPMM

# Least area that is looked up, in texels of the finest level: smaller ones show the same.
LEAST_AREA = 1e-6


class Pyramid(nn.Module):
    """Models of one material, each of half the size of the one before; see `fit_pyramid`.

    Averages of parameters would be no models of averages: a lobe of a mean normal is not the mean
    of two lobes. So each level is a model of its own, fit to averaged values.

    Args:
        levels: the finest first.

    Raises:
        ValueError: there is no level.
    """

    def __init__(self, levels: Sequence[SPMM]) -> None:
        super().__init__()
        if not levels:
            raise ValueError("a pyramid without levels; expected one model at least")
        self.levels = nn.ModuleList(levels)

    @classmethod
    def load(cls, folder: Path | str, device: torch.device | str = "cpu") -> Pyramid:
        """The pyramid that `save` has written.

        Raises:
            OutputError: the folder holds no level 0, or a level is no valid model.
        """
        found = Path(folder).glob("level*.safetensors")
        paths = sorted(found, key=lambda path: (len(path.name), path.name))  # level2, then level10
        if not paths:
            raise OutputError(
                f"{folder} holds no level0.safetensors; expected a folder of Pyramid.save; check "
                f"the path."
            )
        return cls([SPMM.load(path, device) for path in paths])

    def save(self, folder: Path | str) -> None:
        """Writes `level0.safetensors` and so on to a folder, which is made if need be.

        Raises:
            OutputError: a file cannot be written, or a level is not valid.
        """
        with output_errors(Path(folder)):
            Path(folder).mkdir(parents=True, exist_ok=True)
        for number, level in enumerate(self._models()):
            level.save(Path(folder) / f"level{number}.safetensors")

    def forward(
        self, uv: Tensor, wi: Tensor, wo: Tensor, footprint: Tensor, residual: bool = True
    ) -> Tensor:
        """Cosine-weighted reflectance of areas of the texture; see `SPMM.forward`.

        Values of the two levels whose texels are next to the size of an area are mixed by its
        logarithm. Areas smaller than a texel are those of the finest level, areas larger than the
        coarsest level's texels those of that level.

        Args:
            uv: texture coordinates `[..., 2]` of the middle of each area.
            wi, wo: unit directions `[..., 3]`.
            footprint: side of each area in units of the texture's width, `[...]`.
            residual: whether to add epsilon.

        Returns:
            Linear RGB `[..., C]`, differentiable.

        Raises:
            DataError: a direction is not unit, a footprint is below 0, or a number is NaN; see
                `SPMM.checks_queries` of the levels.
        """
        self._check(uv=uv, wi=wi, wo=wo, footprint=footprint)
        parts = uv.shape[:-1], wi.shape[:-1], wo.shape[:-1], footprint.shape
        shape = broadcast_shape(*parts)
        uv, wi, wo = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        shares = self.shares(footprint.expand(shape).reshape(-1))
        total = None
        for level, share in zip(self._models(), shares.unbind(-1), strict=True):
            value = _shared(level, share, uv, wi, wo, residual)
            total = value if total is None else total + value
        assert total is not None
        return total.view(*shape, total.shape[-1])

    @torch.no_grad()
    def pdf(self, uv: Tensor, wi: Tensor, wo: Tensor, footprint: Tensor) -> Tensor:
        """Density `[...]` of `sample` at wi, in 1/sr: those of the levels, mixed as values are.

        Args:
            uv, wi, wo, footprint: as in `forward`.

        Raises:
            DataError: a direction is not unit, a footprint is below 0, or a number is NaN; see
                `SPMM.checks_queries` of the levels.
        """
        self._check(uv=uv, wi=wi, wo=wo, footprint=footprint)
        parts = uv.shape[:-1], wi.shape[:-1], wo.shape[:-1], footprint.shape
        shape = broadcast_shape(*parts)
        uv, wi, wo = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        shares = self.shares(footprint.expand(shape).reshape(-1)).to(wo.dtype)
        density = wo.new_zeros(len(wo))
        for level, share in zip(self._models(), shares.unbind(-1), strict=True):
            rows = torch.nonzero(share).squeeze(-1)
            part = share[rows] * level.pdf(uv[rows], wi[rows], wo[rows])
            density = density.index_add(0, rows, part.to(density.dtype))
        return density.view(shape)

    def sample(
        self, uv: Tensor, wo: Tensor, u: Tensor, footprint: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Light directions drawn by importance: each by one level, chosen by its share.

        Args:
            uv, wo, footprint: as in `forward`.
            u: uniform numbers `[..., 3]` in [0, 1).

        Returns:
            (wi `[..., 3]`, the value of `forward` `[..., C]`, its density `[...]`; see `pdf`).

        Raises:
            DataError: a direction is not unit, a footprint is below 0, or a number is NaN; see
                `SPMM.checks_queries` of the levels.
        """
        self._check(uv=uv, wo=wo, u=u, footprint=footprint)
        parts = uv.shape[:-1], wo.shape[:-1], u.shape[:-1], footprint.shape
        shape = broadcast_shape(*parts)
        uv, wo, u = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wo, 3), (u, 3)))
        side = footprint.expand(shape).reshape(-1)
        with torch.no_grad():
            wi = self._drawn(uv, wo, u, self.shares(side).to(u.dtype))
        value, density = self(uv, wi, wo, side), self.pdf(uv, wi, wo, side)
        return wi.view(*shape, 3), value.view(*shape, value.shape[1]), density.view(shape)

    def _drawn(self, uv: Tensor, wo: Tensor, u: Tensor, shares: Tensor) -> Tensor:
        """wi `[Q, 3]`; the first of the numbers `u [Q, 3]` chooses a level by `shares [Q, N]`."""
        reach = shares.cumsum(-1)
        number = torch.arange(shares.shape[1], device=shares.device)
        last = torch.where(shares > 0.0, number, 0).amax(-1, keepdim=True)  # sums may round below 1
        chosen = (u[:, :1] >= reach).sum(-1, keepdim=True).minimum(last)
        share = shares.gather(1, chosen)
        left = (u[:, :1] - reach.gather(1, chosen) + share) / share
        rest = torch.cat((left.clamp(0.0, 1.0 - torch.finfo(u.dtype).eps), u[:, 1:]), dim=1)
        wi = torch.empty_like(wo)
        for place, level in enumerate(self._models()):
            rows = torch.nonzero(chosen[:, 0] == place).squeeze(-1)
            wi[rows] = level.sample(uv[rows], wo[rows], rest[rows])[0]
        return wi

    def shares(self, footprint: Tensor) -> Tensor:
        """The part of each of N levels in the value of an area, `[..., N]`.

        Args:
            footprint: sides of areas in units of the texture's width, `[...]`.
        """
        side = (footprint * self._models()[0].width).clamp(min=LEAST_AREA)
        last = len(self.levels) - 1
        place = torch.log2(side).clamp(0.0, float(last))
        number = torch.arange(last + 1, device=place.device)
        return (1.0 - (place[..., None] - number).abs()).clamp(min=0.0)

    def _check(self, **parts: Tensor) -> None:
        """Checks what is asked, unless torch records or transforms, or a level is not to check."""
        if not traced() and all(level.checks_queries for level in self._models()):
            check_queries(**parts)

    def _models(self) -> list[SPMM]:
        """The levels, by their type."""
        return [level for level in self.levels if isinstance(level, SPMM)]


def _shared(
    level: SPMM, share: Tensor, uv: Tensor, wi: Tensor, wo: Tensor, residual: bool
) -> Tensor:
    """`share [Q]` times the value of a level, `[Q, C]`; only those that count are evaluated.

    Where torch records or transforms, all are.
    """
    if traced():
        return share[:, None] * level(uv, wi, wo, residual)
    rows = torch.nonzero(share).squeeze(-1)
    value = share[rows, None] * level(uv[rows], wi[rows], wo[rows], residual)
    return value.new_zeros(len(uv), value.shape[1]).index_copy(0, rows, value)
