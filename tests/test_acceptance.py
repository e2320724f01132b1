"""The accuracy that the project promises, on the test data beside the repository."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from spmm_torch import FitConfig, load_btf
from spmm_torch.fit import fit


def _figures() -> ModuleType:
    path = Path(__file__).parent / "benchmarks/material_errors.py"
    spec = importlib.util.spec_from_file_location("figures", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FIGURES = _figures()
DATA = FIGURES.shared_data()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"no test data at {DATA}"),
]


@pytest.mark.parametrize(
    ("name", "without_residual", "with_residual"),
    [("ROCKS64", 6.3, 7.3), ("MOSS64", 0.0, 0.0), ("TILES64", 0.0, 0.0)],
)
def test_path_traced_materials(name: str, without_residual: float, with_residual: float) -> None:
    report = fit(load_btf(DATA / f"{name}.zip"), FitConfig()).report
    snr = report["snr_db"]
    assert snr["without_residual"] >= without_residual
    assert snr["with_residual"] >= max(with_residual, snr["cluster_mean"])
    if name == "ROCKS64":
        assert report["mean_basis_per_texel"] <= 8.0


def test_measured_brdfs() -> None:
    every = 12  # of 159, for the sake of time; tests/benchmarks/material_errors.py fits them all
    snr = [
        fit(btf, FIGURES.FOUR_LOBES).report["snr_db"]["without_residual"]
        for _, btf in FIGURES.measured_brdfs(every)
    ]
    assert np.median(snr) >= 23.0
    assert np.quantile(snr, 0.1) >= 15.0


@pytest.mark.parametrize(("name", "least"), [("carpet07", 19.0), ("felt05", 16.0)])
def test_measured_mean_reflectance(name: str, least: float) -> None:
    btf = dict(FIGURES.measured_means())[name]
    report = fit(btf, FIGURES.FOUR_LOBES).report
    assert report["mean_basis_per_texel"] <= 4.0
    assert report["snr_db"]["without_residual"] >= least
