"""What of a residual its neighbours foresee."""

from __future__ import annotations

import torch

from spmm_torch.fit.residual.trust import _foreseen, trust
from spmm_torch.geometry.directions import ring_directions
from tests.largest_tensor import LargestTensor
from tests.planted.directions import random_directions

DIRECTIONS = ring_directions()


def smooth() -> torch.Tensor:
    """A residual that varies slowly, `[V, 1, L, 3]`."""
    slope = 1.0 + 0.3 * DIRECTIONS[:, 0]
    return (slope[:, None] * slope[None, :])[:, None, :, None].expand(-1, 1, -1, 3)


def test_a_smooth_residual_is_kept() -> None:
    assert float(trust(smooth(), DIRECTIONS, DIRECTIONS).min()) > 0.9


def test_a_spike_is_dropped_and_its_surroundings_stay() -> None:
    functions = smooth().clone()
    functions[40, 0, 30] = 100.0
    kept = trust(functions, DIRECTIONS, DIRECTIONS)
    assert float(kept[40, 30]) < 0.02
    assert float(kept.median()) > 0.9


def test_what_one_of_light_and_view_foresees_is_kept_by_half() -> None:
    """A ridge: alike for all lights of a view, and of either sign from view to view."""
    sign = torch.where(torch.rand(81, generator=torch.Generator().manual_seed(1)) < 0.5, -1.0, 1.0)
    functions = sign[:, None, None, None].expand(-1, 1, 81, 3)
    kept = trust(functions, DIRECTIONS, DIRECTIONS)
    expected = (0.5 + 0.5 * sign * _foreseen(functions, DIRECTIONS, 0)[:, 0, 0, 0]).clamp(0.0, 1.0)
    torch.testing.assert_close(kept, expected[:, None].expand(-1, 81))


def test_what_changes_its_sign_from_pair_to_pair_is_dropped() -> None:
    """By chance neighbours foresee a tenth of noise, which is 5 % of its energy."""
    functions = torch.randn(81, 1, 81, 3, generator=torch.Generator().manual_seed(0))
    kept = trust(functions, DIRECTIONS, DIRECTIONS)
    assert float(kept.mean()) < 0.15
    assert float(kept.square().mean()) < 0.06


def test_neighbours_are_others_even_where_a_direction_is_given_twice() -> None:
    """What they say is the mean of the four nearest others, by inverse squared distance."""
    light = torch.cat((DIRECTIONS, DIRECTIONS[3:4] + 1e-6))
    functions = torch.randn(1, 2, len(light), 3, generator=torch.Generator().manual_seed(0))
    apart = (light.double()[:, None] - light.double()).norm(dim=2).square()
    least = apart.fill_diagonal_(torch.inf).clamp(min=1e-8).topk(4, dim=1, largest=False)
    weight = (1.0 / least.values / (1.0 / least.values).sum(1, keepdim=True)).float()
    told = (weight[..., None] * functions[:, :, least.indices]).sum(3)
    foreseen = _foreseen(functions, light, 2)
    twin = [3, len(light) - 1]
    torch.testing.assert_close(foreseen[:, :, twin], told[:, :, twin])
    assert not _foreseen(functions, DIRECTIONS[:1], 0).any()  # one view has no neighbour


def test_thousands_of_lights_need_no_table_of_their_squares() -> None:
    light = random_directions(3000, seed=1).float()
    functions = torch.ones(1, 2, len(light), 3)
    with LargestTensor() as largest:
        trust(functions, light, DIRECTIONS[:1])
    assert largest.numel <= functions.numel()
