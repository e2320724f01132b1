"""Rotated lobes: one rotation, one cosine, and the coordinates in which they are searched."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import (
    MAX_TILT,
    direction_from_angles,
    direction_pairs,
    frame_from_normal,
    normal_from_disk,
    ring_directions,
)
from spmm_torch.lobes.batch import (
    COORDINATES,
    Feasible,
    LobeBatch,
    anisotropic_mask,
    decode,
    encode,
)
from tests.brdf.brdf_cases import near_mirror, parameters_at, rotate_about_z, upper_directions

ALL = range(len(REGISTRY))
NARROW = 0.1


def random_coordinates(count: int, seed: int, tilt: float = 0.6) -> Tensor:
    """Feasible search coordinates `[count, COORDINATES]`, float64; normals to |disk| = `tilt`."""
    generator = torch.Generator().manual_seed(seed)
    u = torch.rand(count, COORDINATES, generator=generator, dtype=torch.float64)
    radius, turn = tilt * torch.sqrt(u[:, 0]), 2.0 * math.pi * u[:, 1]
    disk = torch.stack((radius * torch.cos(turn), radius * torch.sin(turn)), dim=1)
    return torch.cat((disk, 3.0 * u[:, 2:3] - 1.5, 0.1 + 0.5 * u[:, 3:]), dim=1)


def mixed(count: int, seed: int, tilt: float = 0.6) -> LobeBatch:
    """`count` lobes, all models in turn."""
    return decode(torch.arange(count) % len(REGISTRY), random_coordinates(count, seed, tilt))


def random_pairs(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """(wi, wo), each `[1, count, 3]`, mirror pairs among them."""
    wo = upper_directions(count, seed)
    return near_mirror(wo, 0.5, seed + 1)[None], wo[None]


def expected_values(lobes: LobeBatch, wi: Tensor, wo: Tensor) -> Tensor:
    """rho `[J, D]` of pairs `[D, 3]`, one lobe at a time, straight from [WDR11 Eq. 3]."""
    rows = []
    for j, model in enumerate(lobes.model.tolist()):
        frame = frame_from_normal(lobes.normal[j], lobes.angle[j])
        value = REGISTRY[model].eval(lobes.kappa[j], wi @ frame.T, wo @ frame.T)
        above = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
        rows.append(value * (wi @ lobes.normal[j]).clamp(min=0.0) * above)
    return torch.stack(rows)


def test_eval_is_the_rotated_cosine_weighted_brdf() -> None:
    """And lobes of mixed models keep their order."""
    lobes = mixed(3 * len(REGISTRY), seed=1)
    wi, wo = random_pairs(200, seed=2)
    torch.testing.assert_close(lobes.eval(wi, wo), expected_values(lobes, wi[0], wo[0]))


def test_upright_lobes_are_the_brdf_times_the_cosine() -> None:
    wi, wo = random_pairs(100, seed=3)
    for index, brdf in enumerate(REGISTRY):
        coordinates = random_coordinates(1, seed=4)
        coordinates[:, :3] = 0.0
        lobe = decode(torch.tensor([index]), coordinates)
        expected = brdf.eval(lobe.kappa[0], wi[0], wo[0]) * wi[0, :, 2]
        torch.testing.assert_close(lobe.eval(wi, wo)[0], expected)


def test_order_is_kept_whatever_the_block_size(monkeypatch: pytest.MonkeyPatch) -> None:
    shuffle = torch.randperm(40, generator=torch.Generator().manual_seed(5))
    lobes = mixed(40, seed=6)
    wi, wo = random_pairs(50, seed=7)
    whole = lobes.eval(wi, wo)
    torch.testing.assert_close(lobes[shuffle].eval(wi, wo), whole[shuffle], rtol=0.0, atol=0.0)
    monkeypatch.setattr("spmm_torch.lobes.batch.CPU_BLOCK", 120)
    torch.testing.assert_close(lobes.eval(wi, wo), whole)


def test_zero_below_the_horizons() -> None:
    """Under the lobe's own horizon, and under the texel's though above the lobe's."""
    theta = torch.tensor([1.0], dtype=torch.float64)
    normal = direction_from_angles(theta, torch.zeros(1, dtype=torch.float64))
    upright = mixed(len(REGISTRY), seed=8)
    lobes = LobeBatch(upright.model, upright.kappa, normal.expand(len(REGISTRY), 3), upright.angle)

    def at(degrees: float) -> Tensor:
        polar = torch.tensor(math.radians(degrees), dtype=torch.float64)
        return direction_from_angles(polar, torch.zeros_like(polar))[None, None]

    both = lobes.eval(at(30.0), at(60.0))
    assert bool((both[MODEL_NAMES.index("lambertian")] > 0.0).all())
    own, texel, lit = at(-40.0), at(100.0), at(40.0)
    for wi, wo in ((own, lit), (lit, own), (texel, lit), (lit, texel)):
        assert bool((lobes.eval(wi, wo) == 0.0).all())


def test_values_and_gradients_are_finite_on_measured_directions() -> None:
    lobes = mixed(4 * len(REGISTRY), seed=9, tilt=0.95)
    light = torch.cat((ring_directions(), -ring_directions()[:9])).double()
    value = lobes.eval_grid(light, light)
    assert bool(torch.isfinite(value).all()) and bool((value >= 0.0).all())
    coordinates = encode(lobes).requires_grad_()
    decode(lobes.model, coordinates).eval_grid(light, light).sum().backward()
    assert coordinates.grad is not None and bool(torch.isfinite(coordinates.grad).all())


def test_grid_equals_pairs() -> None:
    light, view = upper_directions(7, seed=10), upper_directions(5, seed=11)
    lobes = mixed(16, seed=12)
    wi, wo = direction_pairs(light, view)
    grid = lobes.eval_grid(light, view)
    assert grid.shape == (16, 35)
    torch.testing.assert_close(grid, lobes.eval(wi[None], wo[None]))


def test_own_directions_for_each_lobe() -> None:
    lobes = mixed(16, seed=13)
    wi, wo = upper_directions(16, seed=14), upper_directions(16, seed=15)
    shared = lobes.eval(wi[None], wo[None])  # [16, 16]
    own = lobes.eval(wi[:, None], wo[:, None])  # [16, 1]
    torch.testing.assert_close(own[:, 0], shared.diagonal())


def test_no_lobes() -> None:
    none = mixed(4, seed=16)[torch.zeros(4, dtype=torch.bool)]
    assert len(none) == 0
    assert none.eval_grid(upper_directions(3, seed=17), upper_directions(2, seed=18)).shape == (
        0,
        6,
    )


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_dtype_is_kept(dtype: torch.dtype) -> None:
    lobes = decode(torch.tensor(ALL), random_coordinates(len(REGISTRY), seed=19).to(dtype))
    directions = upper_directions(4, seed=20).to(dtype)
    assert lobes.kappa.dtype == lobes.normal.dtype == dtype
    assert lobes.eval_grid(directions, directions).dtype == dtype


def test_indexing_and_concatenation() -> None:
    lobes = mixed(10, seed=21)
    again = LobeBatch.cat([lobes[:4], lobes[torch.arange(4, 10)]])
    for field in ("model", "kappa", "normal", "angle"):
        assert torch.equal(getattr(again, field), getattr(lobes, field))
    assert lobes.names() == [MODEL_NAMES[j % len(REGISTRY)] for j in range(10)]
    assert torch.equal(lobes[lobes.angle == 0.0].model, lobes.model[lobes.angle == 0.0])


@pytest.mark.parametrize("turn", [0.7, -2.0])
def test_turning_everything_about_z_changes_nothing(turn: float) -> None:
    """An anisotropic lobe's tangent turns by the same angle."""
    lobes = mixed(3 * len(REGISTRY), seed=22)
    angle = lobes.angle + turn * anisotropic_mask(lobes.model)
    turned = LobeBatch(lobes.model, lobes.kappa, rotate_about_z(lobes.normal, turn), angle)
    wi, wo = random_pairs(100, seed=23)
    there = turned.eval(rotate_about_z(wi, turn), rotate_about_z(wo, turn))
    torch.testing.assert_close(there, lobes.eval(wi, wo), rtol=1e-6, atol=1e-9)


def test_encode_is_the_inverse_of_decode() -> None:
    model = torch.arange(40) % len(REGISTRY)
    coordinates = random_coordinates(40, seed=24)
    lobes = decode(model, coordinates)
    torch.testing.assert_close(lobes.normal.norm(dim=1), torch.ones(40, dtype=torch.float64))
    for j, index in enumerate(model.tolist()):
        count = len(REGISTRY[index].parameters)
        expected = parameters_at(REGISTRY[index], coordinates[j, 3 : 3 + count])
        torch.testing.assert_close(lobes.kappa[j, :count], expected)
        assert bool((lobes.kappa[j, count:] == 0.0).all())
    again = decode(model, encode(lobes))
    for field in ("kappa", "normal", "angle"):
        torch.testing.assert_close(getattr(again, field), getattr(lobes, field))
    isotropic = ~anisotropic_mask(model)
    assert bool((lobes.angle[isotropic] == 0.0).all())
    torch.testing.assert_close(lobes.angle[~isotropic], coordinates[~isotropic, 2])


@pytest.mark.parametrize("min_width", [0.0, NARROW])
def test_projection_is_idempotent_and_ends_in_the_bounds(min_width: float) -> None:
    feasible = Feasible.build(min_width)
    model = torch.arange(200) % len(REGISTRY)
    generator = torch.Generator().manual_seed(25)
    wild = 2.0 * torch.randn(200, COORDINATES, generator=generator, dtype=torch.float64)
    projected = feasible.project(model, wild)
    torch.testing.assert_close(feasible.project(model, projected), projected)
    lobes = decode(model, projected)
    assert float(torch.arccos(lobes.normal[:, 2]).max()) <= MAX_TILT + 1e-6
    for index, brdf in enumerate(REGISTRY):
        for column, row in enumerate(brdf.parameters):
            values = lobes.kappa[model == index, column]
            low, high = row.low, row.high
            if row.from_width is not None and min_width > 0.0:
                limit = row.from_width(min_width)
                widens = row.from_width(1.0) > row.from_width(0.1)
                low, high = (limit, high) if widens else (low, limit)
            slack = 1e-6 * (high - low)
            assert bool((values >= low - slack).all()) and bool((values <= high + slack).all())


def test_projection_leaves_feasible_coordinates() -> None:
    """But for columns that a model does not have."""
    model = torch.arange(40) % len(REGISTRY)
    coordinates = encode(decode(model, random_coordinates(40, seed=26)))
    torch.testing.assert_close(Feasible.build(0.0).project(model, coordinates), coordinates)


def test_normals_of_coordinates() -> None:
    coordinates = random_coordinates(10, seed=31)
    lobes = decode(torch.zeros(10, dtype=torch.long), coordinates)
    torch.testing.assert_close(lobes.normal, normal_from_disk(coordinates[:, :2]))
