"""A fit finds the same in any unit of its values, and names hot pixels."""

from __future__ import annotations

from functools import cache

import pytest
import torch

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.errors import DataError
from spmm_torch.evaluate.sums import squared_errors
from spmm_torch.fit import FitResult, fit
from tests.planted.btfs import rough_btf
from tests.planted.settings import FLAT

SETTINGS = {
    "cluster": {"count": 1},
    "sample": {"per_cluster": 2},
    "search": {"models": ["ward"], "max_lobes": 1, "exchanges": 0, "restarts": 1},
}


def pictures() -> torch.Tensor:
    btf = rough_btf(4)
    return torch.stack([btf.pictures(view) for view in range(len(btf.view))])  # [V, L, H, W, C]


@cache
def fitted(factor: float, error: str = "l2") -> tuple[BTF, FitResult]:
    btf = rough_btf(4)
    given = BTF.from_values((pictures().double() * factor).float(), btf.view, btf.light)
    settings = SETTINGS | FLAT | {"weights": {"error": error}}
    return given, fit(given, FitConfig.from_dict(settings), render=False)


@pytest.mark.parametrize("power", [-100, 60])
def test_a_power_of_two_changes_no_bit(power: int) -> None:
    """Beside ordinary values of the same scale as those that scaling leads to."""
    factor = 2.0**power
    _, known = fitted(2.0**-60)
    _, found = fitted(factor)
    assert found.report["snr_db"] == known.report["snr_db"]
    assert torch.equal(found.model.weight / factor, known.model.weight / 2.0**-60)
    assert torch.equal(found.model.kappa, known.model.kappa)


@pytest.mark.parametrize(("factor", "error"), [(1e-25, "l2"), (1e-25, "cube-root"), (1e18, "l2")])
def test_the_fit_is_as_good_in_any_unit(factor: float, error: str) -> None:
    _, known = fitted(1.0, error)
    btf, found = fitted(factor, error)
    for name, value in known.report["snr_db"].items():
        assert found.report["snr_db"][name] == pytest.approx(value, abs=0.1)
    model = SPMM.from_tensors(*found.model.to_tensors())
    every = torch.ones(btf.pair_count, dtype=torch.bool)
    errors = squared_errors(model, btf, every).totals(every).snr_db()
    for name, value in errors.items():
        assert value == pytest.approx(found.report["snr_db"][name], abs=1e-3)


def test_the_peak_is_in_the_unit_of_the_input() -> None:
    """Values above 1 have their percentile as peak, all others 1."""
    _, high = fitted(1e18)
    btf = rough_btf(4)
    assert high.report["psnr_peak"] == pytest.approx(
        1e18 * BTF.from_values(pictures() * 1e3, btf.view, btf.light).peak() / 1e3
    )
    assert fitted(1e-25)[1].report["psnr_peak"] == 1.0


@pytest.mark.parametrize("scale", [1.0, 1e-20])
def test_a_hot_pixel_is_named(scale: float) -> None:
    btf, values = rough_btf(4), pictures() * scale
    values[3, 4, 1, 2, 1] = 1e20
    given = BTF.from_values(values, btf.view, btf.light)
    place = r"holds 1e\+20 at view 3, light 4, row 1, column 2, where 99.9 % .* hot pixel\.$"
    with pytest.raises(DataError, match=place):
        fit(given, FitConfig.from_dict(SETTINGS | FLAT), render=False)


@pytest.mark.parametrize("highest", [1e-38, 1e-45, 3e38])
def test_what_float32_cannot_compute_with_is_named(highest: float) -> None:
    """Weights and errors beside such values would be none of its numbers."""
    btf, values = rough_btf(4), pictures().double()
    given = BTF.from_values((values / values.max() * highest).float(), btf.view, btf.light)
    with pytest.raises(DataError, match=r"as highest value; expected one from 1e-30 to 1e\+30"):
        fit(given, FitConfig.from_dict(SETTINGS | FLAT), render=False)
