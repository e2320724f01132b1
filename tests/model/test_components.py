"""Components: against a full SVD, a twin in NumPy, and gradients in float64."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.geometry.directions import direction_pairs, ring_directions
from spmm_torch.model.components import (
    Components,
    decode_coefficients,
    decode_functions,
    encode_coefficients,
    encode_functions,
)
from spmm_torch.model.residual import Residual
from tests.planted.directions import random_directions

LIGHT = ring_directions(((0.0, 1), (40.0, 6), (75.0, 12)))
VIEW = ring_directions(((0.0, 1), (30.0, 5), (60.0, 9)))
TEXELS, RANK = 20, 4
TYPES = [torch.int8, torch.float16, torch.float32]


def signed(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def build(dtype: torch.dtype = torch.int8, rank: int = RANK) -> Components:
    functions = signed(rank, len(VIEW), len(LIGHT), 3) * (0.5 ** torch.arange(rank)).view(
        -1, 1, 1, 1
    )
    coefficients = encode_coefficients(signed(TEXELS, rank, seed=1))
    return Components(*encode_functions(functions, dtype), *coefficients, LIGHT, VIEW)


def whole_table(components: Components) -> Tensor:
    """The residual of every texel at every measured pair, `[T, V, L, C]`, written out."""
    functions = decode_functions(components.code, components.scale)
    return torch.einsum("tr,rvlc->tvlc", components.coefficients(), functions)


@pytest.fixture(params=TYPES, ids=str)
def components(request: pytest.FixtureRequest) -> Components:
    return build(request.param)


def queries(count: int = 300) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Texels and shares `[Q, 4]`, directions `[Q, 3]`, some near the horizon."""
    generator = torch.Generator().manual_seed(4)
    texel = torch.randint(TEXELS, (count, 4), generator=generator)
    share = torch.rand(count, 4, generator=generator, dtype=torch.float64)
    wi, wo = (random_directions(count, seed) for seed in (5, 6))
    return texel, share, wi, wo


def test_a_planted_rank_is_that_of_a_full_svd() -> None:
    """What is left beside R components is the tail of the singular values, down to rounding."""
    matrix = signed(TEXELS, 6) @ (
        signed(6, len(VIEW) * len(LIGHT) * 3, seed=1) / torch.arange(1.0, 7.0)[:, None] ** 2
    )
    left, size, right = torch.linalg.svd(matrix, full_matrices=False)
    for rank in (1, 3, 6):
        functions = (size[:rank, None] * right[:rank]).view(rank, len(VIEW), len(LIGHT), 3)
        coded = encode_functions(functions, torch.int8), encode_coefficients(left[:, :rank])
        found = whole_table(Components(*coded[0], *coded[1], LIGHT, VIEW)).flatten(1)
        error, tail = float((matrix - found).norm()), float(size[rank:].norm())
        assert error**2 == pytest.approx(tail**2, rel=0.02, abs=2e-4 * float(matrix.square().sum()))


def test_bytes_round_by_half_a_step() -> None:
    values = signed(TEXELS, RANK) * torch.tensor([1.0, 1e-6, 1e6, 0.0])
    code, scale = encode_coefficients(values)
    assert (code.dtype, code.shape, scale.shape) == (torch.int8, (TEXELS, RANK), (RANK,))
    assert ((decode_coefficients(code, scale) - values).abs() <= 0.501 * scale).all()
    again = encode_coefficients(decode_coefficients(code, scale))
    assert torch.equal(again[0], code)
    functions = signed(RANK, 3, 5, 2) * torch.tensor([1.0, 1e-6, 0.0])[:, None, None]
    code, scale = encode_functions(functions, torch.int8)
    assert (code.dtype, scale.shape) == (torch.int8, (RANK, 3))
    rounding = (decode_functions(code, scale) - functions).abs()
    assert (rounding <= 0.501 * scale[:, :, None, None]).all()


@pytest.mark.parametrize(("dtype", "precision"), [(torch.float16, 2.0**-11), (torch.float32, 0.0)])
def test_functions_of_floats(dtype: torch.dtype, precision: float) -> None:
    values = signed(RANK, 3, 5, 2)
    code, scale = encode_functions(values, dtype)
    assert code.dtype == dtype
    torch.testing.assert_close(decode_functions(code, scale), values, rtol=precision, atol=1e-6)


def test_measured_pairs_return_their_value(components: Components) -> None:
    expected = whole_table(components).flatten(1, 2)  # [T, D, C]
    wi, wo = direction_pairs(LIGHT, VIEW)
    found = components(torch.arange(TEXELS)[:, None], wi, wo)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)
    texel, pair = (
        x.flatten()
        for x in torch.meshgrid(torch.arange(TEXELS), torch.arange(len(wi)), indexing="ij")
    )
    torch.testing.assert_close(components.measured(texel, pair), expected.flatten(0, 1))


def test_against_a_twin_in_numpy(components: Components) -> None:
    """Nine pairs, four texels and all components, summed one after the other."""
    texel, share, wi, wo = queries()
    found = components.blend(texel, share, wi, wo)
    assert found.dtype == torch.float64
    table = whole_table(components).detach().double().flatten(1, 2).numpy()  # [T, D, C]
    pair, weight = (x.numpy() for x in components.pairs.around(wi, wo))
    expected = np.zeros((len(wi), 3))
    for corner in range(4):
        for near in range(9):
            part = table[texel[:, corner].numpy(), pair[:, near]]
            expected += share[:, corner, None].numpy() * weight[:, near, None] * part
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-6, atol=1e-7)
    single = components.blend(texel, share.float(), wi.float(), wo.float())
    torch.testing.assert_close(single.double(), found, rtol=1e-4, atol=1e-4)


def test_one_hot_coefficients_are_the_residual_of_clusters() -> None:
    values, labels = signed(RANK, len(VIEW), len(LIGHT), 3), torch.arange(TEXELS) % RANK
    hot = torch.nn.functional.one_hot(labels, RANK).to(torch.int8)
    components = Components(values, torch.ones(RANK), hot, torch.ones(RANK), LIGHT, VIEW)
    residual = Residual(values, torch.ones(RANK), LIGHT, VIEW)
    texel, share, wi, wo = queries()
    expected = residual.blend(labels[texel], share, wi, wo)
    torch.testing.assert_close(components.blend(texel, share, wi, wo), expected)


def test_no_query(components: Components) -> None:
    texel, share, wi, wo = (x[:0] for x in queries())
    assert components.blend(texel, share, wi, wo).shape == (0, 3)


def test_gradients_in_float64() -> None:
    components = build(torch.float32)
    texel, share, wi, wo = (x[:6] for x in queries())
    share.requires_grad_()
    wi.requires_grad_()
    wo.requires_grad_()
    torch.autograd.gradcheck(lambda *x: components.blend(texel, *x), (share, wi, wo), atol=1e-6)


def test_gradients_reach_functions_and_coefficients() -> None:
    components = build(torch.float32).double()
    components.coefficient = torch.nn.Parameter(components.coefficients().detach().double())
    texel, share, wi, wo = (x[:6] for x in queries())
    for part in (components.code, components.coefficient):
        components.requires_grad_(False)
        part.requires_grad_()
        (slope,) = torch.autograd.grad(components.blend(texel, share, wi, wo).square().sum(), part)
        step = signed(*part.shape, seed=9, dtype=torch.float64)
        values = []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                part += sign * 1e-4 * step
                values.append(components.blend(texel, share, wi, wo).square().sum())
                part -= sign * 1e-4 * step
        assert float((slope * step).sum()) == pytest.approx(float(values[0] - values[1]) / 2e-4)


@torch.no_grad()
def test_what_is_kept_follows_changes_in_place(components: Components) -> None:
    texel, share, wi, wo = queries()
    before = components.blend(texel, share, wi, wo)
    components.scale *= 2.0
    torch.testing.assert_close(components.blend(texel, share, wi, wo), 2.0 * before)
    components.load_state_dict(build(components.code.dtype).state_dict())
    torch.testing.assert_close(components.blend(texel, share, wi, wo), before)
    with torch.inference_mode():
        torch.testing.assert_close(components.blend(texel, share, wi, wo), before)


def test_intensity_is_the_root_mean_square(components: Components) -> None:
    values = whole_table(components).flatten(1)
    torch.testing.assert_close(
        components.intensity(), values.square().mean(1).sqrt(), rtol=1e-3, atol=1e-6
    )
    assert (components.intensity() >= 0.999 * values.abs().mean(1)).all()


@pytest.mark.gpu
def test_same_on_cuda(components: Components) -> None:
    texel, share, wi, wo = queries()
    expected = components.blend(texel, share, wi, wo)
    found = components.to("cuda").blend(texel.cuda(), share.cuda(), wi.cuda(), wo.cuda())
    torch.testing.assert_close(found.cpu(), expected)
