"""`BRDF.eval` against its NumPy twin and finite differences; broadcasting and dtype."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from spmm_torch.brdf import BRDF
from tests.brdf.brdf_cases import (
    ALL_MODELS,
    DTYPES,
    near_mirror,
    parameter_grid,
    parameters_at,
    upper_directions,
)
from tests.brdf.numpy_twins import twin_of

SMALLEST = 1e-290  # of what an exponential in float64 may be kept at


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.2, 1.0])
@pytest.mark.parametrize("model", ALL_MODELS)
def test_equals_the_twin(model: BRDF, spread: float) -> None:
    wo = upper_directions(200, seed=1)
    wi = near_mirror(wo, spread, seed=2)
    for kappa in parameter_grid(model, (0.0, 0.35, 0.7, 1.0)):
        expected = twin_of(model.name)(kappa.numpy(), wi.numpy(), wo.numpy())
        actual = model.eval(kappa, wi, wo).numpy()
        # Where the twin underflows to 0, the exponential is kept at the smallest normal number.
        atol = 1e-9 * expected.max() + SMALLEST
        np.testing.assert_allclose(actual, expected, rtol=1e-7, atol=atol)


@pytest.mark.parametrize("model", ALL_MODELS)
def test_single_precision_equals_double(model: BRDF) -> None:
    wo = upper_directions(200, seed=3)
    wi = near_mirror(wo, 0.2, seed=4)
    kappa = parameter_grid(model, (0.2, 0.6))[:, None]
    expected = model.eval(kappa, wi, wo)
    actual = model.eval(kappa.float(), wi.float(), wo.float()).double()
    torch.testing.assert_close(actual, expected, rtol=3e-3, atol=1e-4 * float(expected.max()))


@pytest.mark.parametrize("model", [param for param in ALL_MODELS if param.values[0].parameters])
def test_gradcheck(model: BRDF) -> None:
    wo = upper_directions(12, seed=5, min_cos=0.1)
    wi = near_mirror(wo, 0.3, seed=6)
    generator = torch.Generator().manual_seed(7)
    shape = (12, len(model.parameters))
    unit = 0.1 + 0.6 * torch.rand(shape, generator=generator, dtype=torch.float64)
    inputs = [x.requires_grad_() for x in (parameters_at(model, unit), wi, wo)]
    assert torch.autograd.gradcheck(model.eval, inputs, eps=1e-7, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("model", ALL_MODELS)
def test_broadcasting_and_dtype(model: BRDF, dtype: torch.dtype) -> None:
    """kappa [J, 1, P] with wi [1, D, 3] and wo [1, D, 3] or [3] gives [J, D]."""
    kappa = parameter_grid(model, (0.2, 0.8), dtype)  # [J, P]
    wi = upper_directions(5, seed=8).to(dtype)
    wo = upper_directions(5, seed=9).to(dtype)
    batch = model.eval(kappa[:, None], wi[None], wo[None])
    assert batch.shape == (len(kappa), 5)
    assert batch.dtype == dtype
    each = torch.stack(
        [torch.stack([model.eval(k, i, o) for i, o in zip(wi, wo, strict=True)]) for k in kappa]
    )
    torch.testing.assert_close(batch, each)
    one_view = model.eval(kappa[:, None], wi[None], wo[0])
    torch.testing.assert_close(one_view[:, 0], batch[:, 0])
    assert model.eval(kappa[0], wi[0], wo[0]).shape == ()


@pytest.mark.parametrize("model", ALL_MODELS)
def test_zero_padded_parameters_change_nothing(model: BRDF) -> None:
    """Lobes of all models share one padded table."""
    kappa = parameter_grid(model, (0.4,))
    padded = torch.nn.functional.pad(kappa, (0, 2))
    wi, wo = upper_directions(10, seed=10), upper_directions(10, seed=11)
    torch.testing.assert_close(model.eval(padded, wi, wo), model.eval(kappa, wi, wo))
