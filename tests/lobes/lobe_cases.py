"""Lobes and views that the tests of sampling share: wide and narrow, upright and tilted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import BRDF, MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.sampling import LobeTable
from tests.planted.lobes import Lobe, lobe_batch

# Widths (slope of the half vector) along tangent and bitangent; the first for isotropic models.
WIDTHS = {"wide": (0.7, 0.35), "narrow": (0.05, 0.02)}
# Where on its scale a parameter stands that sets no width.
OTHER = 0.35
# A model whose lobes need more than widths: mirror lobes off the specular direction, and retro.
SPECIAL: dict[str, dict[str, tuple[float, ...]]] = {
    "lafortune": {"wide": (-1.2, 3.0), "narrow": (-0.95, 400.0), "retro": (0.5, 3.0)},
}
TILT_DEGREES = {"upright": 0.0, "tilted": 35.0}
POLAR_DEGREES = {"normal": 0.0, "oblique": 50.0, "grazing": 85.0}
TILT_AZIMUTH, VIEW_AZIMUTH, TURN = 0.7, 0.3, 0.4


def kappa_of_widths(model: BRDF, widths: tuple[float, float]) -> tuple[float, ...]:
    """Parameters of a lobe of given widths; the others stand at OTHER of their scale."""
    along = iter(widths)
    return tuple(
        float(row.from_unit(torch.tensor(OTHER)))
        if row.from_width is None
        else row.from_width(next(along))
        for row in model.parameters
    )


def kappa_of(model: BRDF) -> dict[str, tuple[float, ...]]:
    """Parameters of the lobes of a model by what they are: wide, and narrow if they can be."""
    has_width = any(row.from_width is not None for row in model.parameters)
    kinds = WIDTHS if has_width else {"wide": WIDTHS["wide"]}
    return {kind: kappa_of_widths(model, widths) for kind, widths in kinds.items()}


KAPPA = {model.name: SPECIAL.get(model.name) or kappa_of(model) for model in REGISTRY}


def unit_vector(degrees: float, azimuth: float) -> Tensor:
    """The direction `[3]` at a polar angle in degrees and an azimuth in radians, float64."""
    angles = torch.tensor([math.radians(degrees), azimuth], dtype=torch.float64)
    return direction_from_angles(angles[0], angles[1])


def lobe(name: str, kappa: tuple[float, ...], tilt: float, azimuth: float = 0.7) -> LobeBatch:
    """One lobe, tilted by `tilt` degrees towards `azimuth`, float64."""
    turn = TURN * REGISTRY[MODEL_NAMES.index(name)].anisotropic
    one = Lobe(name, kappa, tilt, math.degrees(azimuth), math.degrees(turn))
    return lobe_batch(one, dtype=torch.float64)


@dataclass(frozen=True)
class Case:
    """One lobe seen from one view `wo [3]`, as functions of plain tensors."""

    lobes: LobeBatch
    wo: Tensor

    def sample(self, u: Tensor) -> Tensor:
        """wi `[N, 3]` of `u [N, 3]`, in the type of u."""
        first, wo = self._expanded(u)
        return self._table(u).sample(first, wo, u)

    def pdf(self, wi: Tensor) -> Tensor:
        """Density at wi `[N, 3]`."""
        first, wo = self._expanded(wi)
        return self._table(wi).pdf(first, torch.arange(len(first)), wi, wo)

    def rho(self, wi: Tensor) -> Tensor:
        """The lobe at wi `[N, 3]`."""
        return self.lobes.eval(wi[None], self._expanded(wi)[1][None])[0]

    def _table(self, like: Tensor) -> LobeTable:
        lobes = self.lobes
        parts = (part.to(like) for part in (lobes.kappa, lobes.normal, lobes.angle))
        return LobeTable.build(LobeBatch(lobes.model, *parts))

    def _expanded(self, like: Tensor) -> tuple[Tensor, Tensor]:
        return torch.zeros(len(like), dtype=torch.long), self.wo.to(like).expand(len(like), 3)


CASES = [
    pytest.param(
        Case(lobe(name, kappa, tilt), unit_vector(polar, VIEW_AZIMUTH)),
        id=f"{name}-{width}-{tilt_name}-{polar_name}",
    )
    for name, widths in KAPPA.items()
    for width, kappa in widths.items()
    for tilt_name, tilt in TILT_DEGREES.items()
    for polar_name, polar in POLAR_DEGREES.items()
]
