"""Coefficients of functions that all texels share, against dense least squares."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch.fit.refit import components as module
from spmm_torch.fit.refit.components import (
    coefficients,
    first_coefficients,
    gram_by_view,
    lobe_kernel,
    seen,
    seen_by_components,
    seen_by_lobes,
)
from tests.fit.refit.refit_cases import CASES, LIGHT, VIEW, Case

RANK = 3
CLOSE: dict[str, Any] = {"rtol": 1e-4, "atol": 1e-4}


@pytest.fixture(params=CASES)
def sample(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def functions(scale: float = 1.0) -> Tensor:
    """B `[V, R, L, C]`."""
    generator = torch.Generator().manual_seed(4)
    return scale * torch.randn(len(VIEW), RANK, len(LIGHT), 3, generator=generator)


def coefficient(sample: Case) -> Tensor:
    """c `[T, R]`."""
    generator = torch.Generator().manual_seed(5)
    return torch.randn(sample.pictures.texel_count, RANK, generator=generator)


def test_normal_matrix_of_the_coefficients(sample: Case) -> None:
    design = sample.component_design(functions()).flatten(4).flatten(0, 3)
    own = coefficient(sample)
    gram = gram_by_view(functions(), sample.scale)
    expected = design.T @ (design @ own.double().flatten())
    found = seen(own, gram, sample.lookups)
    torch.testing.assert_close(found, expected.float().view_as(found), rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("scale", [1.0, 1e-12])
def test_coefficients(sample: Case, scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CONVERGED", 1e-10)
    design = sample.component_design(functions(scale)).flatten(4).flatten(0, 3)
    values = scale * sample.values().flatten()
    rhs = (design.T @ values).view(-1, RANK)
    gram = gram_by_view(functions(scale), sample.scale)
    found = coefficients(rhs, gram, sample.lookups, steps=200)
    expected = torch.linalg.lstsq(design, values).solution
    torch.testing.assert_close(found.double().flatten(), expected, rtol=1e-3, atol=1e-3)


def test_functions_that_vanish_have_no_coefficients() -> None:
    sample = CASES["relief"]
    zero = torch.zeros(sample.pictures.texel_count, RANK)
    gram = torch.zeros(len(VIEW), RANK, RANK)
    assert torch.equal(coefficients(zero.double(), gram, sample.lookups, steps=5), zero)


def test_what_lobes_and_components_show_of_each_other(sample: Case) -> None:
    kernel = lobe_kernel(functions(), sample.rho, sample.scale)
    shown = sample.component_design(functions()).flatten(4)  # [V, T, L, C, T R]
    own = coefficient(sample)
    of_residual = shown @ own.double().flatten()  # [V, T, L, C]
    expected = torch.einsum("vpln,vplc->nc", sample.lobe_design(), of_residual)
    found = seen_by_lobes(own, kernel, sample.lookups, sample.entries)
    torch.testing.assert_close(found, expected, **CLOSE)
    weight = sample.entries.weight.double()
    of_lobes = torch.einsum("vpln,nc->vplc", sample.lobe_design(), weight)
    expected = torch.einsum("vplcm,vplc->m", shown, of_lobes).view(-1, RANK)
    found = seen_by_components(sample.entries, kernel, sample.lookups)
    torch.testing.assert_close(found, expected, **CLOSE)


def test_first_coefficients_span_what_the_lobes_leave() -> None:
    """Values are lobes plus a residual of rank R, known by their principal coordinates."""
    sample = CASES["flat"]
    generator = torch.Generator().manual_seed(6)
    rho = sample.rho.transpose(0, 1).flatten(1)  # [J, D]
    texels, width = sample.pictures.texel_count, rho.shape[1] * 3
    truth = torch.randn(texels, RANK, generator=generator)
    residual = truth @ torch.randn(RANK, width, generator=generator)
    lobes = torch.zeros(texels, rho.shape[1], 3)
    own = sample.entries.weight[:, None] * rho[sample.entries.index][:, :, None]
    values = lobes.index_add_(0, sample.texel, own).flatten(1) + residual
    left, size, right = torch.linalg.svd(values, full_matrices=False)
    found = first_coefficients(
        left * size, right.T.reshape(-1, 3, len(size)).transpose(1, 2), sample.entries, rho, RANK
    )
    assert found.shape == (texels, RANK)
    inside = found @ torch.linalg.lstsq(found, truth).solution
    torch.testing.assert_close(inside, truth, rtol=1e-3, atol=1e-3)


def test_texels_without_lobes() -> None:
    sample = CASES["relief"]
    count = len(sample.entries.offset)
    none = replace(
        sample.entries,
        offset=torch.zeros(count, dtype=torch.long),
        index=sample.entries.index[:0],
        weight=sample.entries.weight[:0],
    )
    kernel = lobe_kernel(functions(), sample.rho, None)
    assert not bool(seen_by_components(none, kernel, sample.lookups).any())
    own = coefficient(sample)
    assert seen_by_lobes(own, kernel, sample.lookups, none).shape == (0, 3)
