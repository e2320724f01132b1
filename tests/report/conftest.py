"""A small model, a BTF that it nearly equals, and the report of their run."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import PAPER_MODELS
from spmm_torch.data import BTF
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import COORDINATES, decode
from spmm_torch.model.residual import Residual
from spmm_torch.model.spmm import SPMM, SparseWeights

CLUSTERS, LOBES = 4, 2 * len(PAPER_MODELS)
NAME = '<b>"wool" & felt</b>'


def build_model(directions: Tensor, height: int, width: int, most_lobes: int) -> SPMM:
    """Texels of 0 to `most_lobes` random lobes each, in clusters with a random residual."""
    generator = torch.Generator().manual_seed(3)
    texels, count = height * width, len(directions)
    coordinates = torch.rand(LOBES, COORDINATES, generator=generator)
    lobes = decode(torch.arange(LOBES) % len(PAPER_MODELS), coordinates * 0.5)
    used = torch.randint(most_lobes + 1, (texels,), generator=generator)
    index = torch.cat([torch.randperm(LOBES, generator=generator)[:number] for number in used])
    weights = SparseWeights(
        torch.cat((used.new_zeros(1), used.cumsum(0))),
        index,
        torch.rand(len(index), 3, generator=generator),
    )
    code = 0.1 * torch.rand(CLUSTERS, count, count, 3, generator=generator)
    residual = Residual(code, torch.ones(CLUSTERS), directions, directions)
    labels = torch.randint(CLUSTERS, (texels,), generator=generator)
    light = directions.clone()  # safetensors refuses tensors that share memory
    return SPMM(height, width, lobes, weights, labels, residual, light, directions, NAME)


def pictures_of(model: SPMM) -> BTF:
    """The BTF that `model` is exact for, float32."""
    with torch.no_grad():
        values = [[model.picture(wi, wo) for wi in model.light] for wo in model.view]
    stacked = torch.stack([torch.stack(row) for row in values])  # [V, L, H, W, C]
    return BTF.from_values(stacked, model.view, model.light, name=NAME)


@pytest.fixture(scope="session")
def model() -> SPMM:
    """5 x 7 texels on 19 x 19 directions."""
    return build_model(ring_directions(((0.0, 1), (45.0, 8), (75.0, 10))), 5, 7, most_lobes=5)


@pytest.fixture(scope="session")
def btf(model: SPMM) -> BTF:
    """What the model is exact for; its name has to be escaped."""
    return pictures_of(model)


@pytest.fixture(params=[0, 3])
def one_texel(request: pytest.FixtureRequest) -> tuple[SPMM, BTF]:
    """A single texel, without lobes too."""
    small = build_model(ring_directions(((0.0, 1), (45.0, 8))), 1, 1, request.param)
    return small, pictures_of(small)


@pytest.fixture
def report() -> dict[str, Any]:
    """A full report."""
    return {
        "input": "data/wool & felt.npz",
        "texels": 35,
        "direction_pairs": 361,
        "channels": 3,
        "clusters": CLUSTERS,
        "total_basis": LOBES,
        "mean_basis_per_texel": 4.8,
        "bytes": {"weights": 1800, "dictionary": 700, "residual": 21660, "total": 24500},
        "raw_bytes": 151_620,
        "compression_ratio": 151_620 / 24_500,
        "psnr_peak": 1.0,
        "psnr_db": {"without_residual": 18.75, "with_residual": 30.79},
        "snr_db": {"without_residual": 13.98, "with_residual": 26.02, "cluster_mean": 21.5},
        "weighted_snr_db": None,
        "mssim": {"y": None, "cr": None, "cb": None, "mean": None},
        "lobes_by_model": {"lambertian": 40, "ward": 20},
        "failed_starts": {"starts": 5120, "count": 3, "not_finite": 1, "no_descent": 2},
        "solvers": {
            "nnls": {"converged": 105, "limit": 1, "no_descent": 0, "not_finite": 0},
        },
        "error_without_model": {
            "texels": 35,
            "snr_db": 13.98,
            "snr_db_without": {"lambertian": 9.5, "ward": 12.25},
        },
        "auto": None,
        "seconds": {
            "load": 0.2,
            "cluster": 1.0,
            "search": 21.5,
            "dictionary": 0.1,
            "select": 8.0,
            "refit": 2.0,
            "residual": 0.5,
            "evaluate": 0.3,
            "total": 33.6,
        },
        "peak_memory_bytes": 1_300_000_000,
        "device": "cpu",
        "seed": 0,
        "versions": {"spmm_torch": "0.1.0", "torch": "2.13.0"},
    }
