"""Lobes and views that the tests of sampling share: wide and narrow, upright and tilted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.sampling import LobeTable

KAPPA: dict[str, dict[str, tuple[float, ...]]] = {
    "lambertian": {"wide": ()},
    "oren_nayar": {"wide": (0.6,)},
    "blinn_phong": {"wide": (4.0,), "narrow": (2000.0,)},
    "ward": {"wide": (0.7, 0.35), "narrow": (0.05, 0.02)},
    "cook_torrance": {"wide": (0.6, 0.3), "narrow": (0.03, 0.3)},
    "lafortune": {"wide": (-1.2, 3.0), "narrow": (-0.95, 400.0), "retro": (0.5, 3.0)},
    "ashikhmin_shirley": {"wide": (3.0, 12.0, 0.3), "narrow": (200.0, 3000.0, 0.3)},
    "ward_duer": {"wide": (0.7, 0.35), "narrow": (0.05, 0.02)},
}
TILT_DEGREES = {"upright": 0.0, "tilted": 35.0}
POLAR_DEGREES = {"normal": 0.0, "oblique": 50.0, "grazing": 85.0}
TILT_AZIMUTH, VIEW_AZIMUTH, TURN = 0.7, 0.3, 0.4


def unit_vector(degrees: float, azimuth: float) -> Tensor:
    """The direction `[3]` at a polar angle in degrees and an azimuth in radians, float64."""
    angles = torch.tensor([math.radians(degrees), azimuth], dtype=torch.float64)
    return direction_from_angles(angles[0], angles[1])


def lobe(name: str, kappa: tuple[float, ...], tilt: float, azimuth: float = 0.7) -> LobeBatch:
    """One lobe, tilted by `tilt` degrees towards `azimuth`, float64."""
    model = MODEL_NAMES.index(name)
    padded = torch.zeros(1, MAX_PARAMETERS, dtype=torch.float64)
    padded[0, : len(kappa)] = torch.tensor(kappa, dtype=torch.float64)
    turn = torch.tensor([TURN * REGISTRY[model].anisotropic], dtype=torch.float64)
    return LobeBatch(torch.tensor([model]), padded, unit_vector(tilt, azimuth)[None], turn)


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
