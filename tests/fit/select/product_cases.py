"""Random texels and atoms with their products, and the same sums written out."""

from __future__ import annotations

import torch
from torch import Tensor

from spmm_torch.config.fit import SelectConfig, StagewiseConfig
from spmm_torch.fit.select.products import Products, cluster_products
from spmm_torch.fit.select.target import taken_by_residual, target_beside_residual
from spmm_torch.fit.select.texels import Fit, select, squared_errors

TEXELS, ATOMS, PAIRS, CHANNELS = 12, 7, 60, 3


def case(seed: int = 0) -> tuple[Tensor, Tensor, Products]:
    generator = torch.Generator().manual_seed(seed)
    atoms = torch.rand(ATOMS, PAIRS, generator=generator)
    atoms = atoms / atoms.norm(dim=1, keepdim=True)
    values = torch.rand(TEXELS, PAIRS, CHANNELS, generator=generator)
    parts = [slice(0, 5), slice(5, TEXELS)]
    products = cluster_products(
        lambda p: values.transpose(1, 2)[p],
        parts,
        (TEXELS, CHANNELS),
        atoms,
        points=values.flatten(1),
    )
    return atoms, values, products


def mean_weights(fit: Fit) -> Tensor:
    """The mean weight of every atom, `[J, C]`."""
    return fit.total_weights(ATOMS) / TEXELS


def errors(products: Products, fit: Fit) -> tuple[Tensor, float]:
    """(without residual, of each texel; what the residual takes away from their sum)."""
    return squared_errors(products, fit), taken_by_residual(products, mean_weights(fit))


def chosen(products: Products, method: str = "corrective", **settings: object) -> Fit:
    config = SelectConfig(method=method, **settings)
    return select(products, target_beside_residual(products, None, 0.0), config, StagewiseConfig())


def expand(fit: Fit, atoms: Tensor) -> Tensor:
    """D x of every texel, `[n, D, C]`."""
    used = atoms[fit.index.clamp(min=0)] * (fit.index >= 0)[..., None]
    return torch.einsum("nmd,nmc->ndc", used, fit.weights)
