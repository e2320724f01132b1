"""Whole fits on the simulated device: each gives the model that the host finds."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from spmm_torch import FitConfig
from spmm_torch.benchmark.launches.tally import Tally
from spmm_torch.data import blocks
from spmm_torch.fit import FitResult, fit
from spmm_torch.fit.select import alternate
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import rough_btf
from tests.planted.reliefs import planted_relief
from tests.planted.settings import FLAT

SIDE = 5
VIEWS = ((0.0, 1), (30.0, 5), (50.0, 6))
QUICK: dict[str, Any] = {
    "cluster": {"count": 2},
    "sample": {"per_cluster": 2},
    "search": {
        "models": ["lambertian", "ward"],
        "max_lobes": 2,
        "restarts": 1,
        "bank_normals": 12,
        "exchanges": 0,
        "refine_steps": 1,
        "final_steps": 2,
        "pairs": 64,
        "adam_steps": 2,
        "lbfgs_steps": 2,
    },
    "select": {"max_lobes": 3},
    "residual": {"rank": 2},
}
CASES: dict[str, dict[str, Any]] = {
    "clusters' residual": {**FLAT, "search": {"exchanges": 2, "restarts": 2}},
    "both residuals": {"relief": {"mode": "off"}, "residual": {"clusters": True}},
    "by a pilot, of lobes of its own": {
        "relief": {"mode": "off"},
        "select": {"pilot": 2},
        "dictionary": {"scope": "cluster"},
    },
    "glossy, by a pilot": {
        "relief": {"mode": "off"},
        "weights": {"error": "cube-root"},
        "select": {"pilot": 8},
        "cluster": {"count": 1},
    },
    "stagewise": {
        **FLAT,
        "search": {"method": "stagewise"},
        "stagewise": {"eta": 0.2, "lambda_min": 0.2, "max_steps": 6},
        "dictionary": {"scope": "cluster"},
        "select": {"method": "stagewise"},
        "residual": {"rank": 0, "clusters": True, "joint": False},
    },
}


def quick(device: str, sections: dict[str, Any]) -> FitConfig:
    """Settings of a fit of seconds, with some changed."""
    merged = {name: {**QUICK.get(name, {}), **part} for name, part in sections.items()}
    return FitConfig.from_dict({**QUICK, **merged, "device": device})


def check_same(found: FitResult, expected: FitResult) -> None:
    """The same lobes and errors; the model is handed on in host memory."""
    assert not any(part.is_cuda for part in found.model.parameters())
    for name, value in expected.report["snr_db"].items():
        assert found.report["snr_db"][name] == pytest.approx(value, abs=0.01)
    host, device = expected.model.to_tensors()[0], found.model.to_tensors()[0]
    for name in ("dictionary.model", "weights.index", "weights.label"):
        assert torch.equal(host[name], device[name]), name


@pytest.mark.parametrize("case", CASES)
def test_fits(case: str, cuda: Tally) -> None:
    btf = rough_btf(SIDE)
    expected, found = (
        fit(btf, quick(device, CASES[case]), render=False) for device in ("cpu", "cuda")
    )
    assert found.report["device"] == "cuda (simulated)"
    check_same(found, expected)


def test_a_relief(cuda: Tally) -> None:
    """It is found, aligned through, and its weights are fit to the pictures."""
    btf = planted_relief(size=(24, 24), views=ring_directions(VIEWS)).btf
    expected, found = (fit(btf, quick(device, {}), render=False) for device in ("cpu", "cuda"))
    assert found.model.relief is not None
    check_same(found, expected)


def test_memory_is_bounded_by_blocks(cuda: Tally, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of some texels give the model of whole clusters."""
    btf, config = rough_btf(SIDE), quick("cuda", FLAT)
    whole = fit(btf, config, render=False)
    monkeypatch.setattr(blocks, "CUDA_BLOCK_VALUES", 10 * btf.pair_count * 3)
    monkeypatch.setattr(alternate, "CUDA_TEXELS", 10)
    assert blocks.block_texels(btf, torch.device("cuda")) == 10
    check_same(fit(btf, config, render=False), whole)
