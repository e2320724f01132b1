"""The closure nearest to each lobe: kind, roughness and scale, by least squares about its peak."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..brdf.ggx import WIDTH_OF_ALPHA
from ..edit.widths import power_law
from ..lobes.batch import LobeBatch
from . import closures
from .closures import ALPHA_X, ALPHA_Y, F0, KINDS, SIGMA

# Views of the fit by polar angle and azimuth, in degrees.
VIEW_ANGLES, VIEW_AZIMUTHS = (5.0, 25.0, 45.0, 60.0, 72.0), (20.0, 65.0)
# Half vectors: radii in widths of the lobe, and azimuths; lights of lobes without a width.
RADII, AZIMUTHS = 9, 8
FARTHEST = 2.5
# Factors on the width, and values of sigma, that are tried.
FACTORS = (0.5, 0.63, 0.75, 0.87, 1.0, 1.15, 1.33, 1.6, 2.0)
SIGMAS = (0.15, 0.3, 0.45, 0.6, 0.8, 1.0)
# Widest slope of half vectors, of lobes without a width.
WHOLE = 0.8


@dataclass(frozen=True)
class ClosureLobes:
    """A closure for each of J lobes, in the frame of the lobe.

    Attributes:
        kind: places in `closures.KINDS`, `[J]`.
        parameters: see `closures.value`, `[J, 4]`.
        scale: what the closure is multiplied by, `[J]`.
        error: squared error relative to the lobe's square, about its peak, `[J]`.
    """

    kind: Tensor
    parameters: Tensor
    scale: Tensor
    error: Tensor


@torch.no_grad()
def fitted(lobes: LobeBatch) -> ClosureLobes:
    """The nearest closure of each lobe."""
    width, f0 = widths_of(lobes)
    wi, wo, share = fit_directions(width)
    expected = _values(lobes, wi, wo)  # [J, Q]
    energy = (share * expected * expected).sum(1).clamp(min=1e-30)
    count = len(lobes)
    best = ClosureLobes(
        torch.zeros(count, dtype=torch.long),
        torch.zeros(count, 4),
        torch.zeros(count),
        torch.full((count,), torch.inf),
    )
    for kind, parameters in _candidates(width, f0):
        stacked = parameters[:, None].expand(*wi.shape[:2], 4)
        closure = closures.CLOSURES[KINDS[kind]](stacked, wi, wo) * (wi[..., 2] > 0.0)
        scale = (share * closure * expected).sum(1) / (share * closure**2).sum(1).clamp(min=1e-30)
        error = (share * (expected - scale[:, None] * closure) ** 2).sum(1) / energy
        better = error < best.error
        best = ClosureLobes(
            torch.where(better, kind, best.kind),
            torch.where(better[:, None], parameters, best.parameters),
            torch.where(better, scale, best.scale),
            torch.where(better, error, best.error),
        )
    return best


def widths_of(lobes: LobeBatch) -> tuple[Tensor, Tensor]:
    """(widths along tangent and bitangent `[J, 2]`, infinite without one; F0 `[J]`, 1 without)."""
    width = torch.full((len(lobes), 2), torch.inf)
    f0 = torch.ones(len(lobes))
    for model, rows in lobes.by_model():
        column = 0
        for place, row in enumerate(REGISTRY[model].parameters):
            value = lobes.kappa[rows, place].cpu()
            if row.from_width is not None:
                a, b = power_law(row.from_width)
                width[rows, column] = (value / a) ** (1.0 / b)
                column += 1
            elif row.name == "f0":
                f0[rows] = value
        if column == 1:
            width[rows, 1] = width[rows, 0]
    return width, f0


def fit_directions(width: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Local wi and wo `[J, Q, 3]` about the peaks of lobes of widths `[J, 2]`, and areas `[J, Q]`.

    Half vectors lie on rings of slopes, in widths of the lobe; wi is wo mirrored about them.
    """
    reach = torch.where(width.isfinite(), width * FARTHEST, WHOLE * FARTHEST).clamp(max=2.0)
    radius = (torch.arange(RADII) + 0.5) / RADII
    azimuth = (torch.arange(AZIMUTHS) + 0.25) * (2.0 * math.pi / AZIMUTHS)
    ring = torch.stack((azimuth.cos(), azimuth.sin()), dim=-1)
    slope = (radius[:, None, None] * ring).flatten(0, 1)  # [h, 2]
    slopes = slope * reach[:, None]  # [J, h, 2]
    h = torch.cat((slopes, torch.ones_like(slopes[..., :1])), dim=-1)
    h = h / h.norm(dim=-1, keepdim=True)
    theta, phi = (
        torch.deg2rad(angle)
        for angle in torch.cartesian_prod(
            torch.tensor(VIEW_ANGLES), torch.tensor(VIEW_AZIMUTHS)
        ).unbind(1)
    )
    view = torch.stack((theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), dim=-1)
    wo = view[:, None].expand(-1, len(slope), -1).flatten(0, 1).expand(len(width), -1, -1)
    h = h[:, None].expand(-1, len(view), -1, -1).flatten(1, 2)
    wi = 2.0 * (h * wo).sum(-1, keepdim=True) * h - wo
    area = radius[:, None].expand(-1, AZIMUTHS).flatten().repeat(len(view))
    return wi, wo, area * (wi[..., 2] > 0.0)


def _values(lobes: LobeBatch, wi: Tensor, wo: Tensor) -> Tensor:
    """Lobes in their own frames, times the cosine of the light, `[J, Q]`."""
    result = torch.zeros(wi.shape[:2])
    for model, rows in lobes.by_model():
        rows = rows.cpu()
        kappa = lobes.kappa.cpu()[rows][:, None]
        result[rows] = REGISTRY[model].eval(kappa, wi[rows], wo[rows]) * wi[rows][..., 2]
    return result


def _candidates(width: Tensor, f0: Tensor) -> list[tuple[int, Tensor]]:
    """Every kind with all its parameters `[J, 4]` that are tried."""
    parameters = torch.zeros(len(width), 4)
    parameters[:, F0] = f0
    parameters[:, [ALPHA_X, ALPHA_Y]] = 1.0
    found = [(KINDS.index("DIFFUSE"), parameters)]
    for sigma in SIGMAS:
        rough = parameters.clone()
        rough[:, SIGMA] = sigma
        found.append((KINDS.index("OREN_NAYAR"), rough))
    known = torch.where(width.isfinite(), width, 1.0)
    for factor in FACTORS:
        for kind in KINDS[2:]:
            shaped = parameters.clone()
            scaled = factor * known
            if kind.endswith("GGX"):
                scaled = scaled / WIDTH_OF_ALPHA
            elif kind == "ASHIKHMIN_SHIRLEY":
                scaled = scaled / torch.sqrt(1.0 + scaled * scaled)
            shaped[:, [ALPHA_X, ALPHA_Y]] = scaled.clamp(closures.LEAST_ALPHA, 1.0)
            found.append((KINDS.index(kind), shaped))
    return found
