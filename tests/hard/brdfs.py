"""Measured BRDFs between the directions on which they were fit.

Fit at 81 x 81 directions (`COARSE`) and judged at the rings that UBO2014's 151 directions have
between those, 72 x 72 pairs with mirror directions of their own; or fit at 151 x 151 directions
(`DENSE`) and judged at 150 x 150 on rings halfway between.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.fit import FitResult, fit
from spmm_torch.geometry.directions import (
    UBO2003_RINGS,
    UBO2014_RINGS,
    direction_pairs,
    ring_directions,
)
from spmm_torch.metrics import snr_db
from spmm_torch.render.btf_material import BTFMaterial
from tests.measured import FOUR_LOBES, brdf_btf, measured_brdf

# The relative error between samples may be this many times that on samples.
FACTOR = 2.0
Rings = tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class Directions:
    """Rings of directions: on which a BRDF is measured, and between them."""

    measured: Rings
    between: Rings


def _between(rings: Rings) -> Rings:
    """Rings halfway between those given, with as many directions as the outer of both."""
    return tuple((0.5 * (inner[0] + outer[0]), outer[1]) for inner, outer in pairwise(rings))


_COARSE = {polar for polar, _ in UBO2003_RINGS}
COARSE = Directions(UBO2003_RINGS, tuple(ring for ring in UBO2014_RINGS if ring[0] not in _COARSE))
DENSE = Directions(UBO2014_RINGS, _between(UBO2014_RINGS))


@dataclass(frozen=True)
class Figure:
    """SNR in dB of the fit of one BRDF.

    Attributes:
        on_samples: of the lobes.
        between: of the lobes, between the samples.
        whole: of lobes and residual, which is interpolated, between the samples.
        interpolated: of the samples themselves, interpolated in the same way.
    """

    name: str
    on_samples: float
    between: float
    whole: float
    interpolated: float

    @property
    def ratio(self) -> float:
        """Relative error (root mean square) between samples over that on samples."""
        return 10.0 ** ((self.on_samples - self.between) / 20.0)


def fitted(
    name: str, config: FitConfig = FOUR_LOBES, directions: Directions = COARSE
) -> tuple[BTF, FitResult]:
    """One BRDF on the measured directions, and its fit."""
    measured = ring_directions(directions.measured)
    btf = brdf_btf(name, measured)
    return btf, fit(btf, config)


def figure(btf: BTF, result: FitResult, directions: Directions = COARSE) -> Figure:
    """Looks between the measured directions of a BRDF."""
    between = ring_directions(directions.between)
    wi, wo = direction_pairs(between, between)
    truth, uv = measured_brdf(btf.name, between), torch.full((len(wi), 2), 0.5)

    def snr(found: Tensor) -> float:
        error = float((found.double() - truth).square().sum())
        return snr_db(float(truth.square().sum()), error)

    with torch.no_grad():
        return Figure(
            btf.name,
            result.report["snr_db"]["without_residual"],
            snr(result.model(uv, wi, wo, residual=False)),
            snr(result.model(uv, wi, wo)),
            snr(BTFMaterial.build(btf)(uv, wi, wo)),
        )
