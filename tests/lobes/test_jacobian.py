"""Slopes of lobes along the search coordinates, against autograd and differences."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY
from spmm_torch.lobes.batch import COORDINATES, decode
from spmm_torch.lobes.jacobian import Directions, linearize
from tests.lobes.test_batch import random_coordinates, random_pairs


def split(found: Tensor) -> tuple[Tensor, Tensor]:
    """Values `[J, D]` and derivatives `[J, COORDINATES, D]`."""
    return found[:, 0], found[:, 1:]


@pytest.mark.parametrize("horizon", [0.0, 0.2])
@pytest.mark.parametrize("index", range(len(REGISTRY)), ids=MODEL_NAMES)
def test_jacobian_equals_autograd_and_differences(index: int, horizon: float) -> None:
    count, step = 6, 1e-6
    model = torch.full((count,), index)
    coordinates = random_coordinates(count, seed=27)
    wi, wo = random_pairs(20, seed=28)
    rho, slope = split(linearize(model, coordinates, Directions(wi, wo), horizon))
    assert slope.shape == (count, COORDINATES, 20)

    def lobes(x: Tensor) -> Tensor:
        return decode(model, x, horizon).eval(wi, wo)

    torch.testing.assert_close(rho, lobes(coordinates))
    full = torch.autograd.functional.jacobian(lobes, coordinates)  # [J, D, J, COORDINATES]
    each = full.diagonal(dim1=0, dim2=2).permute(2, 1, 0)  # [J, COORDINATES, D]
    torch.testing.assert_close(slope, each)
    # A step over the horizon of a lobe or over a kink of a model is no fault: the median is taken.
    for column in range(COORDINATES):
        shift = torch.zeros(COORDINATES, dtype=torch.float64)
        shift[column] = step
        difference = (lobes(coordinates + shift) - lobes(coordinates - shift)) / (2.0 * step)
        error = (difference - slope[:, column]).abs() / (1.0 + slope[:, column].abs())
        assert float(error.median()) < 1e-7
        assert float(error.quantile(0.9)) < 1e-4


def test_jacobian_of_mixed_models_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    model = torch.arange(24) % len(REGISTRY)
    coordinates = random_coordinates(24, seed=29)
    wi, wo = random_pairs(15, seed=30)
    rho, slope = split(linearize(model, coordinates, Directions(wi, wo)))
    monkeypatch.setattr("spmm_torch.lobes.jacobian.CPU_BLOCK_VALUES", 100)
    again, slope_again = split(linearize(model, coordinates, Directions(wi, wo)))
    torch.testing.assert_close(again, rho)
    torch.testing.assert_close(slope_again, slope)
    for j, index in enumerate(model.tolist()):
        missing = 3 + len(REGISTRY[index].parameters)
        assert bool((slope[j, missing:] == 0.0).all())
        assert REGISTRY[index].anisotropic or bool((slope[j, 2] == 0.0).all())
    assert COORDINATES == 3 + MAX_PARAMETERS
