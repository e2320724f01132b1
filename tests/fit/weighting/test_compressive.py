"""Weights of pairs against the errors that they stand for."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.fit.glossy.compression import DARK
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.weighting.compressive import compressive_weights
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import texel_btf

CPU = torch.device("cpu")


def relative(first: torch.Tensor, second: torch.Tensor) -> float:
    """Squared error of `second` relative to the energy of `first`."""
    return float((first - second).square().sum() / first.square().sum())


@pytest.mark.parametrize("error", ["balanced", "cube-root"])
def test_weighted_errors_are_those_of_compressed_values(error: str) -> None:
    generator = torch.Generator().manual_seed(0)
    values = 0.5 + 10.0 * torch.rand(6561, 1, generator=generator, dtype=torch.float64) ** 8
    values = values.expand(6561, 3)
    btf = texel_btf(values[None].float(), ring_directions())
    weight = compressive_weights(btf, Objective(error), CPU).pair
    assert weight is not None
    dark = DARK * float(values[:, 0].pow(1.0 / 3.0).mean()) ** 3

    def wanted(near: torch.Tensor) -> float:
        # What is dark counts as a little brighter, for the compressed part alone.
        seen = relative(*((part + dark) ** (1.0 / 3.0) for part in (values, near)))
        return seen if error == "cube-root" else relative(values, near) + seen

    def found(near: torch.Tensor) -> float:
        return float((weight[:, None] * (near - values).square()).sum())

    # Weights have mean 1, so the ratio of an error of bright values to one of dark ones tells.
    bright = torch.where(values > 5.0, 1.001 * values, values)
    dim = torch.where(values < 0.6, 1.001 * values, values)
    assert found(bright) / found(dim) == pytest.approx(wanted(bright) / wanted(dim), rel=0.01)
