"""The values that codes stand for, against naive formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from spmm_torch.data import expansion as module
from spmm_torch.data.codecs.radiance import RgbeExpansion
from spmm_torch.data.expansion import DepthExpansion, Expansion, FloatExpansion, TableExpansion
from tests.planted.pictures import random_codes


def test_rgbe_is_ldexp() -> None:
    mantissa, exponent = np.mgrid[0:256, 0:256]
    codes = np.stack((mantissa, 255 - mantissa, mantissa ^ 0x55, exponent), -1).astype(np.uint8)
    exact = np.ldexp(codes[..., :3].astype(np.float64), exponent[..., None] - 136)
    exact[exponent == 0] = 0.0
    values = RgbeExpansion()(torch.from_numpy(codes))
    assert values.dtype == torch.float32
    np.testing.assert_array_equal(values.double().numpy(), exact)
    assert float(values.max()) == math.ldexp(255.0, 255 - 136)  # nothing is cut off


@pytest.mark.parametrize("gamma", [1.0, 2.2, 0.5])
def test_eight_bits_are_a_power(gamma: float) -> None:
    codes = torch.arange(256, dtype=torch.uint8).view(4, 64)
    expected = [(code / 255.0) ** gamma for code in range(256)]
    values = TableExpansion.gamma(gamma)(codes)
    torch.testing.assert_close(values, torch.tensor(expected).view(4, 64), rtol=1e-7, atol=0)
    assert (values[0, 0], values[-1, -1]) == (0.0, 1.0)


@pytest.mark.parametrize("gamma", [1.0, 2.2, 0.5])
def test_sixteen_bits_are_a_power(gamma: float) -> None:
    codes = torch.from_numpy(np.arange(65536, dtype=np.uint16).reshape(4, -1))
    expected = (np.arange(65536) / 65535.0) ** gamma
    values = DepthExpansion(gamma)(codes)
    np.testing.assert_allclose(values.flatten().numpy(), expected, rtol=1e-7)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float16", "float32"])
def test_the_type_of_codes_tells_their_depth(kind: str) -> None:
    """Codes of 8 and 16 bits are encoded, floats are not."""
    codes = torch.from_numpy(random_codes(kind, (3, 5)))
    white = 1.0 if codes.is_floating_point() else float(np.iinfo(kind).max)
    exact = codes.double() / white
    expected = exact if codes.is_floating_point() else exact**2.2
    torch.testing.assert_close(DepthExpansion(2.2)(codes), expected.float())


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_values_do_not_depend_on_the_blocks(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    expand = DepthExpansion(2.2)
    codes = torch.from_numpy(random_codes(kind, (9, 8)))
    whole = expand(codes)
    monkeypatch.setattr(module, "LOOKUP_CHUNK", 7)
    assert torch.equal(expand(codes), whole)
    assert torch.equal(expand(codes[:, 2:5]), whole[:, 2:5])  # apart in memory
    assert torch.equal(expand(codes[::2]), whole[::2])
    assert expand(codes[:0]).shape == (0, 8, 3)


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32])
def test_floats_stay_as_they_are(dtype: torch.dtype) -> None:
    largest = torch.finfo(dtype).max
    codes = torch.tensor([0.0, torch.finfo(dtype).tiny, 1.0, largest], dtype=dtype)
    values = FloatExpansion()(codes)
    assert values.dtype == torch.float32
    assert torch.equal(values.to(dtype), codes)


def test_bounds(kind: str) -> None:
    expansions: dict[str, Expansion] = {
        "uint8": TableExpansion.gamma(2.2),
        "uint16": DepthExpansion(2.2),
        "rgbe": RgbeExpansion(),
    }
    expand = expansions.get(kind, FloatExpansion())
    codes = torch.from_numpy(random_codes(kind, (4, 5), seed=3))
    values = expand(codes)
    assert expand.bounds(codes) == (float(values.min()), float(values.max()))


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32])
def test_bounds_tell_of_nan(dtype: torch.dtype) -> None:
    codes = torch.ones(3, 4, 5, dtype=dtype)
    codes[1, 2, 3] = math.nan
    assert all(map(math.isnan, FloatExpansion().bounds(codes)))


@pytest.mark.gpu
def test_same_bits_on_cuda(kind: str) -> None:
    codes = torch.from_numpy(random_codes(kind, (40, 50)))
    expansions = {"uint8": TableExpansion.gamma(2.2), "rgbe": RgbeExpansion()}
    expand = expansions.get(kind, FloatExpansion())
    assert torch.equal(expand(codes.cuda()).cpu(), expand(codes))
