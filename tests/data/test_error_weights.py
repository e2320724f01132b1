"""Weights: what they refuse, their scale, and that weighting is repeating."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.data.error_weights import UNIFORM, Weights
from spmm_torch.errors import DataError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import random_btf

VIEW = ring_directions(((0.0, 1), (40.0, 2)))
LIGHT = ring_directions(((0.0, 1), (50.0, 3)))
HEIGHT, WIDTH = 2, 5


def make_btf(missing: Tensor | None = None) -> BTF:
    btf = random_btf(LIGHT, HEIGHT, WIDTH, VIEW, low=0.1)
    btf.missing = missing
    return btf


def some(shape: tuple[int, int], seed: int = 1) -> Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


PAIRS, TEXELS = (len(VIEW), len(LIGHT)), (HEIGHT, WIDTH)


def changed(value: float) -> Tensor:
    weights = some(PAIRS)
    weights[1, 2] = value
    return weights


BAD = {
    "shape": ({"pair": some(TEXELS)}, "'pair' of the weights has shape [2, 5]; expected [3, 4]"),
    "texel shape": ({"texel": some(PAIRS)}, "'texel' of the weights has shape [3, 4]"),
    "negative": ({"pair": changed(-1.0)}, "'pair' of the weights holds -1.0 at [1, 2]"),
    "nan": ({"pair": changed(float("nan"))}, "holds nan at [1, 2]"),
    "infinite": ({"pair": changed(float("inf"))}, "holds inf at [1, 2]"),
    "zero": ({"pair": torch.zeros(PAIRS)}, "'pair' of the weights is 0 wherever"),
    "zero texels": ({"texel": torch.zeros(TEXELS)}, "'texel' of the weights is 0 wherever"),
    "whole numbers": ({"pair": torch.ones(PAIRS, dtype=torch.int64)}, "expected floats"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_weights_are_refused(case: str) -> None:
    parts, message = BAD[case]
    with pytest.raises(DataError) as error:
        Weights.build(make_btf(), **parts)
    assert message in str(error.value)


def test_weights_on_missing_pairs_only_are_refused() -> None:
    missing = torch.zeros(PAIRS, dtype=torch.bool)
    missing[1, 2] = True
    with pytest.raises(DataError, match="0 wherever something was measured"):
        Weights.build(make_btf(missing), missing.float())


def test_scale_does_not_matter_and_the_mean_is_one() -> None:
    btf = make_btf()
    first = Weights.build(btf, some(PAIRS), some(TEXELS))
    second = Weights.build(btf, 1e6 * some(PAIRS), 1e-6 * some(TEXELS))
    torch.testing.assert_close(first.pair, second.pair)
    torch.testing.assert_close(first.texel, second.texel)
    assert first.pair.mean() == pytest.approx(1.0)
    assert first.texel.mean() == pytest.approx(1.0)


def test_missing_pairs_weigh_nothing_whatever_the_floor() -> None:
    missing = some(PAIRS, 4) < 0.3
    weights = Weights.build(make_btf(missing), some(PAIRS)).floored(0.5)
    assert torch.equal(weights.pair == 0.0, missing.flatten())
    assert weights.pair[~missing.flatten()].mean() == pytest.approx(1.0)
    alone = Weights.build(make_btf(missing))
    torch.testing.assert_close(alone.pair, (~missing.flatten()).float())
    assert not alone.uniform


def test_a_floor_leaves_nothing_without_weight() -> None:
    pair = torch.zeros(PAIRS)
    pair[0, 0] = 1.0
    weights = Weights.build(make_btf(), pair).floored(0.1)
    assert weights.pair.min() == pytest.approx(0.1)
    assert weights.pair.mean() == pytest.approx(1.0)
    assert Weights.build(make_btf(), pair).floored(0.0).pair.count_nonzero() == 1


def test_products_of_weights() -> None:
    btf = make_btf()
    both = Weights.build(btf, some(PAIRS)).times(Weights.build(btf, some(PAIRS, 2)))
    product = (some(PAIRS) * some(PAIRS, 2)).flatten()
    torch.testing.assert_close(both.pair, product / product.mean())
    assert UNIFORM.times(UNIFORM).uniform
    assert torch.equal(UNIFORM.times(Weights(texel=torch.ones(10))).texel, torch.ones(10))
    left, right = torch.zeros(PAIRS), torch.zeros(PAIRS)
    left[0, 0] = right[1, 1] = 1.0
    with pytest.raises(DataError, match="the product of all weights is 0"):
        Weights.build(btf, left).times(Weights.build(btf, right))


def test_values_are_scaled_by_the_square_root() -> None:
    btf = make_btf()
    weights = Weights.build(btf, some(PAIRS))
    scaled = weights.signals(btf, slice(0, 4), "cpu").transpose(1, 2)
    expected = btf.texels(slice(0, 4)) * weights.pair.sqrt()[:, None]
    torch.testing.assert_close(scaled, expected)
    plain = UNIFORM.signals(btf, slice(0, 4), "cpu")
    assert torch.equal(plain.transpose(1, 2), btf.texels(slice(0, 4)))


def test_the_digest_tells_weights_apart() -> None:
    btf = make_btf()
    assert UNIFORM.digest() is None
    first = Weights.build(btf, some(PAIRS)).digest()
    assert first == Weights.build(btf, some(PAIRS)).digest()
    assert first != Weights.build(btf, some(PAIRS, 2)).digest()
