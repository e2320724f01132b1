"""Every hard case is fit within its bounds, and no start of its search fails silently."""

from __future__ import annotations

import math

import pytest

from tests.hard.cases import CASES, Case


@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in CASES.items()])
def test_bounds(case: Case) -> None:
    result = case.fit()
    report, model = result.report, result.model
    assert report["snr_db"]["without_residual"] >= case.lobes
    assert report["snr_db"]["with_residual"] >= case.model
    if case.between is not None:
        assert case.snr_between(result) >= case.between
    assert report["failed_starts"]["starts"] > 0
    assert report["failed_starts"]["not_finite"] == 0
    for tensor in model.state_dict().values():
        assert bool(tensor.isfinite().all())
    assert not math.isnan(report["psnr_db"]["with_residual"])
