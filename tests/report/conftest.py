"""A small model, a BTF that it nearly equals, and the report of their run."""

from __future__ import annotations

from typing import Any

import pytest

from spmm_torch.brdf import PAPER_MODELS
from spmm_torch.data import BTF
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.model.spmm import SPMM
from tests.planted.btfs import measured
from tests.planted.models import uneven_model

CLUSTERS, NAMES = 4, 2 * PAPER_MODELS
NAME = '<b>"wool" & felt</b>'


@pytest.fixture(scope="session")
def model() -> SPMM:
    """5 x 7 texels of 0 to 5 lobes on 19 x 19 directions; its name has to be escaped."""
    directions = ring_directions(((0.0, 1), (45.0, 8), (75.0, 10)))
    counts = [texel % 6 for texel in range(35)]
    return uneven_model(counts, 5, directions, directions, CLUSTERS, NAMES, name=NAME)


@pytest.fixture(scope="session")
def btf(model: SPMM) -> BTF:
    """What the model is exact for."""
    return measured(model)


@pytest.fixture(params=[0, 3])
def one_texel(request: pytest.FixtureRequest) -> tuple[SPMM, BTF]:
    """A single texel, without lobes too."""
    directions = ring_directions(((0.0, 1), (45.0, 8)))
    small = uneven_model([request.param], 1, directions, directions, names=NAMES, name=NAME)
    return small, measured(small)


@pytest.fixture
def report() -> dict[str, Any]:
    """A full report."""
    return {
        "input": "data/wool & felt.npz",
        "texels": 35,
        "direction_pairs": 361,
        "channels": 3,
        "clusters": CLUSTERS,
        "total_basis": len(NAMES),
        "mean_basis_per_texel": 4.8,
        "bytes": {"weights": 1800, "dictionary": 700, "residual": 21660, "total": 24500},
        "bytes_per_texel": 64.0,
        "raw_bytes": 151_620,
        "compression_ratio": 151_620 / 24_500,
        "psnr_peak": 1.0,
        "psnr_db": {"without_residual": 18.75, "with_residual": 30.79},
        "snr_db": {"without_residual": 13.98, "with_residual": 26.02, "cluster_mean": 21.5},
        "weighted_snr_db": None,
        "mssim": {"y": None, "cr": None, "cb": None, "mean": None},
        "sharpness": {
            "from_above": 0.42,
            "all_views": 0.35,
            "in_place_from_above": 0.31,
            "in_place_all_views": 0.22,
        },
        "display": {
            "psnr_db": {"without_residual": 21.25, "with_residual": 24.5},
            "flip": {"without_residual": 0.151, "with_residual": 0.112},
            "slices": 48,
        },
        "lobes_by_model": {"lambertian": 40, "ward": 20},
        "objective": {
            "error": "cube-root",
            "chosen_by": "data",
            "narrow_lobes": 3,
            "narrow_energy": 0.12,
        },
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
        "materials": None,
        "seconds": {
            "load": 0.2,
            "objective": 0.1,
            "relief": 2.5,
            "cluster": 1.0,
            "search": 21.5,
            "dictionary": 0.1,
            "select": 8.0,
            "refit": 2.0,
            "residual": 0.5,
            "evaluate": 0.3,
            "total": 36.1,
        },
        "peak_memory_bytes": 1_300_000_000,
        "device": "cpu",
        "seed": 0,
        "versions": {"spmm_torch": "0.1.0", "torch": "2.13.0"},
        "contents": {"version": "0.1.0", "state": 3, "input": "00", "weights": None},
        "format": 1,
    }
