"""Errors of near-perfect fits, against the sums written out in float64."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import FitConfig
from spmm_torch.fit import fit
from spmm_torch.fit.residual.exact import exact_errors, is_doubtful
from spmm_torch.fit.select.products import cluster_products
from spmm_torch.fit.select.texels import Fit, squared_errors
from spmm_torch.geometry.directions import direction_pairs, ring_directions
from spmm_torch.metrics import snr_db
from tests.planted.btfs import COARSE_RINGS, random_btf

# The fewest steps that find a lobe.
SEARCH = {"search": {"max_lobes": 1, "restarts": 1, "bank_normals": 8, "exchanges": 0}}
TEXELS, ATOMS, PAIRS, CHANNELS = 7, 5, 900, 3


def nearly_exact(noise: float) -> tuple[Tensor, Tensor, list[Fit], Tensor]:
    """Values `[T, D, C]` that two fits meet but for noise, atoms, the fits, and a residual."""
    generator = torch.Generator().manual_seed(0)
    atoms = torch.rand(ATOMS, PAIRS, generator=generator)
    atoms = atoms / atoms.norm(dim=1, keepdim=True)
    index = torch.rand(TEXELS, ATOMS, generator=generator).argsort(1)[:, :3]
    weights = 0.5 + torch.rand(TEXELS, 3, CHANNELS, generator=generator)
    index[0, 2], weights[0, 2] = -1, 0.0  # a texel of two lobes
    chosen = atoms.double()[index.clamp(min=0)]  # [T, M, D]
    values = torch.einsum("tmd,tmc->tdc", chosen, weights.double())
    values += noise * torch.randn(values.shape, generator=generator, dtype=torch.float64)
    residual = 0.5 * noise * torch.randn(PAIRS, CHANNELS, generator=generator)
    fits = [Fit(index[:4], weights[:4]), Fit(index[4:, :], weights[4:])]
    return values.float(), atoms, fits, residual


def written_out(values: Tensor, atoms: Tensor, fits: list[Fit], residual: Tensor) -> list[float]:
    index, weights = torch.cat([f.index for f in fits]), torch.cat([f.weights for f in fits])
    chosen = atoms.double()[index.clamp(min=0)]
    error = values.double() - torch.einsum("tmd,tmc->tdc", chosen, weights.double())
    return [float(x.square().sum()) for x in (error, error - residual.double())]


@pytest.mark.parametrize("noise", [1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize("size", [2, TEXELS])
def test_true_errors(noise: float, size: int) -> None:
    case = nearly_exact(noise)
    values, atoms, fits, residual = case
    parts = [slice(i, min(i + size, TEXELS)) for i in range(0, TEXELS, size)]
    found = exact_errors(lambda part: values.transpose(1, 2)[part], parts, fits, atoms, residual)
    assert list(found) == pytest.approx(written_out(*case), rel=0.01)


def test_the_gram_algebra_could_not_tell() -> None:
    """Why there is a pass more: 100 dB are lost in the rounding of the products."""
    values, atoms, fits, residual = case = nearly_exact(1e-6)
    whole = [slice(0, TEXELS)]
    products = cluster_products(
        lambda part: values.transpose(1, 2)[part], whole, (TEXELS, CHANNELS), atoms
    )
    fit = Fit(torch.cat([f.index for f in fits]), torch.cat([f.weights for f in fits]))
    truth, _ = written_out(*case)
    by_gram = float(squared_errors(products, fit).sum())
    assert abs(by_gram - truth) > truth
    assert is_doubtful(by_gram, float(products.energy.sum()))
    assert not is_doubtful(1e-4, 1.0)


@pytest.mark.parametrize("residual", [{"rank": 0, "clusters": True}, {"rank": 2, "clusters": True}])
@pytest.mark.parametrize("error", ["l2", "cube-root"])
def test_near_perfect_fits_report_what_the_model_does(residual: dict, error: str) -> None:
    directions = ring_directions(COARSE_RINGS)
    btf = random_btf(directions, 1, 1)
    settings = {"residual": {**residual, "precision": "float32"}, "weights": {"error": error}}
    result = fit(btf, FitConfig.from_dict({**SEARCH, **settings}), render=False)
    wi, wo = direction_pairs(directions, directions)
    with torch.no_grad():
        found = result.model(torch.full((len(wi), 2), 0.5), wi, wo)
    truth = btf.texels(slice(None))[0].double()
    own = snr_db(float(truth.square().sum()), float((found.double() - truth).square().sum()))
    reported = result.report["snr_db"]["with_residual"]
    rounding = 10.0 ** (-own / 20.0) - 10.0 ** (-reported / 20.0)
    assert own > 60.0 and abs(rounding) < 1e-6
