"""Lists of pairs in place of a grid: the same values, pair by pair."""

from __future__ import annotations

import math

import torch

from spmm_torch.lobes.batch import encode
from spmm_torch.lobes.grid import DirectionGrid
from tests.planted.scattered import LOBES, random_pairs

CPU = torch.device("cpu")


def test_a_list_has_the_values_of_its_pairs() -> None:
    wi, wo = random_pairs(50, 1)
    scale = torch.linspace(0.5, 2.0, 50)
    grid = DirectionGrid.of_pairs(wi, wo, CPU, scale, LOBES.horizon)
    every = DirectionGrid.build(wi, wo, CPU, horizon=LOBES.horizon)
    expected = every.eval(LOBES).view(3, 50, 50).diagonal(dim1=1, dim2=2) * scale
    torch.testing.assert_close(grid.eval(LOBES), expected)
    model, coordinates = LOBES.model[None], encode(LOBES)[None]
    torch.testing.assert_close(grid.values(model, coordinates)[0], expected, rtol=1e-4, atol=1e-5)
    rho, derivative = grid.jacobian(model, coordinates)
    torch.testing.assert_close(rho[0], expected, rtol=1e-4, atol=1e-5)
    assert derivative.shape[-1] == grid.pair_count == 50
    pair = torch.tensor([[7, 3], [1, 1], [0, 49]])
    torch.testing.assert_close(grid.eval_at(LOBES, pair), expected.gather(1, pair))
    torch.testing.assert_close(grid.part(slice(10, 20)).eval(LOBES), expected[:, 10:20])


def test_spacing_shrinks_as_the_root_of_the_number_of_pairs() -> None:
    few, many = (
        DirectionGrid.of_pairs(*random_pairs(count, 2), CPU).spacing for count in (500, 8000)
    )
    assert few < math.pi / 2
    assert 3.0 < few / many < 5.0  # sixteen times as many
    one = DirectionGrid.of_pairs(*random_pairs(1, 2), CPU)
    assert one.at(torch.tensor([0]))[1].shape == (1, 3)
