"""What each pixel shows, against dense matrices that are made pixel by pixel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch.fit.refit import lookups as lookups_module
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
        run = slice(view, view + 1)
        torch.testing.assert_close(lookups.drawn(run).to_dense(), own, **CLOSE)
        torch.testing.assert_close(lookups.gathered(run) @ values, own.T @ values, **CLOSE)
        torch.testing.assert_close(lookups.squared(run, values), own.T @ own @ values, **CLOSE)


def test_runs_of_views(sample: Case) -> None:
    """Several views at once, as a GPU takes them."""
    lookups, run = sample.lookups, slice(1, len(VIEW))
    dense = sample.shown()[run].float()  # [n, T, T]
    texels = dense.shape[1]
    same = torch.rand(texels, 3, generator=torch.Generator().manual_seed(1))
    own = torch.rand(len(dense) * texels, 3, generator=torch.Generator().manual_seed(2))
    by_view = own.view(-1, texels, 3)
    expected = (
        (lookups.drawn(run) @ same, dense @ same),
        (lookups.drawn(run, apart=True) @ own, dense @ by_view),
        (lookups.gathered(run) @ own, (dense.mT @ by_view).sum(0)),
        (lookups.gathered(run, apart=True) @ own, dense.mT @ by_view),
        (lookups.squared(run, own), (dense.mT @ dense @ by_view).sum(0)),
        (lookups.squared_apart(run, same), dense.mT @ dense @ same),
    )
    for found, wanted in expected:
        torch.testing.assert_close(found.reshape(wanted.shape), wanted, **CLOSE)


def test_a_device_takes_as_many_views_as_it_has_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    lookups = case(2, 3, rule="repeat").lookups
    assert lookups.runs() == [slice(v, v + 1) for v in range(len(VIEW))]
    monkeypatch.setattr(lookups_module, "CUDA_PIXELS", 13)
    there = replace(lookups, texel=lookups.texel.as_subclass(OnDevice))
    assert there.runs(1, 4) == [slice(1, 3), slice(3, 4)]
    monkeypatch.setattr(lookups_module, "CUDA_PIXELS", 5)
    assert there.runs() == lookups.runs()


class OnDevice(Tensor):
    """A tensor that says it is on a GPU."""

    is_cuda = True  # type: ignore[assignment]


def test_squares(sample: Case) -> None:
    dense = sample.shown()
    table = sample.lookups.squares(slice(0, sample.lookups.views))
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
