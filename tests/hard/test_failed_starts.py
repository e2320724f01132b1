"""Starts that meet NaN, or from which nothing goes down: counted, reported and left out."""

from __future__ import annotations

import io

import pytest
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.brdf import REGISTRY
from spmm_torch.fit import fit
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Progress
from tests.hard.cases import CASES, QUICK, merged

LAFORTUNE = [brdf.name for brdf in REGISTRY].index("lafortune")


@pytest.fixture
def btf(monkeypatch: pytest.MonkeyPatch) -> BTF:
    """Retro-reflection, while the BRDF for it has slopes that are no numbers for sharp lobes."""
    btf = CASES["retro"].make()
    brdf = REGISTRY[LAFORTUNE]
    whole = brdf.eval

    def eval_broken(kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        rest = ((11.0 - kappa[..., 1]) * (kappa[..., 1] < 11.0)).sqrt()  # infinite slope at 0
        return whole(kappa, wi, wo) + 0.0 * rest

    monkeypatch.setattr(brdf, "eval", eval_broken)
    monkeypatch.setattr(brdf, "slopes", lambda *_: None)  # those of `eval` are recorded
    return btf


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_counted_and_left_out(btf: BTF, method: str) -> None:
    small = {"search": {"method": method, "pairs": 64, "adam_steps": 4, "lbfgs_steps": 8}}
    config = FitConfig.from_dict(merged(QUICK, small)).override(["stagewise.max_steps=12"])
    told = io.StringIO()
    result = fit(btf, config, Context.build(config.device, progress=Progress(told)))
    failed = result.report["failed_starts"]
    assert 0 < failed["not_finite"] <= failed["count"] < failed["starts"]
    assert f"{failed['not_finite']} of {failed['starts']} starts" in told.getvalue()
    assert all(bool(tensor.isfinite().all()) for tensor in result.model.state_dict().values())
    assert result.report["snr_db"]["without_residual"] > 10.0


def test_nothing_fails_and_nothing_is_said_otherwise() -> None:
    told = io.StringIO()
    report = fit(
        CASES["retro"].make(),
        FitConfig.from_dict(QUICK),
        Context.build(QUICK["device"], progress=Progress(told)),
    ).report
    assert report["failed_starts"]["not_finite"] == 0
    assert "starts" not in told.getvalue()
