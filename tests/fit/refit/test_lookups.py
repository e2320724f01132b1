"""What each pixel shows, against dense matrices that are made pixel by pixel."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch.fit.refit.lookups import HALF
from spmm_torch.geometry.directions import RULES
from tests.fit.refit.refit_cases import VIEW, Case, case, flat

SIZES = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1), (2, 3), (3, 2), (3, 3), (4, 6)]
CLOSE: dict[str, Any] = {"rtol": 1e-4, "atol": 2e-5}


@pytest.fixture(params=SIZES, ids=str)
def size(request: pytest.FixtureRequest) -> tuple[int, int]:
    return request.param


@pytest.fixture(params=RULES)
def rule(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=["relief", "drift", "flat"])
def sample(request: pytest.FixtureRequest, size: tuple[int, int], rule: str) -> Case:
    drifts = request.param == "drift"
    found = case(*size, rule=rule, drift=drifts, importance=drifts)
    return flat(found) if request.param == "flat" else found


def test_matrices(sample: Case) -> None:
    lookups, dense = sample.lookups, sample.shown()
    assert lookups.mixed == (sample.drift is not None or bool(sample.field.height.any()))
    values = torch.rand(dense.shape[1], 3, generator=torch.Generator().manual_seed(1))
    for view in range(len(VIEW)):
        own = dense[view].float()
        torch.testing.assert_close(lookups.drawn(view).to_dense(), own, **CLOSE)
        torch.testing.assert_close(lookups.gathered(view) @ values, own.T @ values, **CLOSE)
        torch.testing.assert_close(lookups.squared(view, values), own.T @ own @ values, **CLOSE)


def test_squares(sample: Case) -> None:
    dense = sample.shown()
    table = sample.lookups.squares()
    rows, columns = sample.field.height.shape
    found = torch.stack([whole_square(own, rows, columns) for own in table])
    torch.testing.assert_close(found, (dense.mT @ dense).float(), **CLOSE)


def whole_square(table: Tensor, rows: int, columns: int) -> Tensor:
    """W^T W `[T, T]` of the halves `[T, 5]` that the table has."""
    found = torch.zeros(rows * columns, rows * columns)
    for texel, line in enumerate(table):
        row, column = divmod(texel, columns)
        for (down, right), value in zip(HALF, line, strict=True):
            other = (row + down) % rows * columns + (column + right) % columns
            found[texel, other] += value
            if (down, right) != (0, 0):
                found[other, texel] += value
    return found
