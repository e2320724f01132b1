"""Weights on a logarithmic scale, and lobes by groups: what a file gives back, and back again."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.edit.entries import entry_texels
from spmm_torch.model.lookup import SparseWeights
from spmm_torch.model.stored_weights import (
    GROUP,
    LEAST_SHARE,
    by_lobe,
    decode_entries,
    decode_weights,
    encode_entries,
    encode_weights,
    rounded,
)
from spmm_torch.runtime import tensor_file
from tests.planted.directions import random_directions
from tests.planted.models import FEW_RINGS, planted_model, with_components

TYPES = [torch.uint8, torch.int16]


def spread(count: int, decades: float, seed: int = 0) -> Tensor:
    """Weights `[N, 3]` over some decades, a tenth of them 0."""
    generator = torch.Generator().manual_seed(seed)
    weight = 10.0 ** (-decades * torch.rand(count, 3, generator=generator))
    return weight * (torch.rand(count, 3, generator=generator) > 0.1)


@pytest.mark.parametrize("dtype", TYPES, ids=str)
@given(decades=st.floats(0.0, 12.0), size=st.floats(-9.0, 9.0), seed=st.integers(0, 100))
def test_codes_round_to_a_share_of_each_weight(
    dtype: torch.dtype, decades: float, size: float, seed: int
) -> None:
    weight = 10.0**size * spread(50, decades, seed)
    code, limits = encode_weights(weight, dtype)
    found = decode_weights(code, limits)
    assert (code.dtype, found.dtype) == (dtype, torch.float32)
    least = LEAST_SHARE[dtype] * weight.amax(0)
    kept = weight >= least
    step = -math.log(LEAST_SHARE[dtype]) / (torch.iinfo(dtype).max - 1)
    ratio = (found[kept] / weight[kept]).log().abs()
    assert float(ratio.max()) <= 0.501 * step + 1e-6
    assert ((found - weight).abs()[~kept] <= (2.0 * least).expand_as(weight)[~kept]).all()
    assert torch.equal(found[weight == 0.0], torch.zeros(int((weight == 0.0).sum())))


@pytest.mark.parametrize("dtype", TYPES, ids=str)
@given(decades=st.floats(0.0, 12.0), seed=st.integers(0, 1000))
def test_a_second_time_changes_nothing(dtype: torch.dtype, decades: float, seed: int) -> None:
    once = encode_weights(spread(40, decades, seed), dtype)
    again = encode_weights(decode_weights(*once), dtype)
    assert all(map(torch.equal, again, once))


@pytest.mark.parametrize("dtype", TYPES, ids=str)
def test_against_a_twin_in_numpy(dtype: torch.dtype) -> None:
    code, limits = encode_weights(spread(200, 4.0), dtype)
    least, largest = limits.double().numpy().T
    place = (code.numpy() - 1.0) / (torch.iinfo(dtype).max - 1)
    expected = np.where(code.numpy() > 0, least * (largest / least) ** place, 0.0)
    np.testing.assert_allclose(decode_weights(code, limits).numpy(), expected, rtol=1e-6)


@pytest.mark.parametrize("dtype", TYPES, ids=str)
@pytest.mark.parametrize(
    "weight",
    [
        torch.zeros(4, 3),
        torch.zeros(0, 3),
        torch.full((4, 3), 0.7),
        torch.tensor([[1.0, 0.0, -1.0]]),
    ],
    ids=["all zero", "none", "all equal", "negative"],
)
def test_corner_cases(dtype: torch.dtype, weight: Tensor) -> None:
    code, limits = encode_weights(weight, dtype)
    assert limits.isfinite().all()
    assert torch.equal(decode_weights(code, limits), weight.clamp(min=0.0))


def entries(lobes: int, texels: int = 30, most: int = 12, seed: int = 0) -> SparseWeights:
    """Some lobes of each texel, in no order."""
    generator = torch.Generator().manual_seed(seed)
    count = torch.randint(min(most, lobes) + 1, (texels,), generator=generator)
    index = [torch.randperm(lobes, generator=generator)[:n] for n in count.tolist()]
    offset = torch.cat((torch.zeros(1, dtype=torch.long), count.cumsum(0)))
    return SparseWeights(offset, torch.cat(index), torch.rand(int(offset[-1]), 3))


@pytest.mark.parametrize("lobes", [1, 255, GROUP, GROUP + 1, 1000, 40_000])
def test_lobes_come_back(lobes: int) -> None:
    weights = by_lobe(entries(lobes))
    stored = encode_entries(weights, lobes)
    offset, index = decode_entries(stored)
    assert torch.equal(offset, weights.offset)
    assert torch.equal(index, weights.index)
    plain = tensor_file.narrow(weights.index).element_size() * len(index) + len(offset) - 1
    taken = sum(x.numel() * x.element_size() for x in (stored.count, stored.index))
    assert taken <= plain
    if lobes == 1000:
        assert (stored.count.shape, stored.index.dtype) == ((30, 4), torch.uint8)


def test_sorting_moves_weights_with_their_lobes() -> None:
    weights = entries(50)
    ordered = by_lobe(weights)
    for first, last in zip(weights.offset[:-1], weights.offset[1:], strict=True):
        order = weights.index[first:last].argsort()
        assert torch.equal(ordered.index[first:last], weights.index[first:last][order])
        assert torch.equal(ordered.weight[first:last], weights.weight[first:last][order])


def stored_model(dtype: torch.dtype) -> SPMM:
    """A model with components whose weights are those of its file."""
    model = with_components(planted_model(rings=FEW_RINGS), 2)
    weights = rounded(model.sparse_weights, dtype)
    model.index, model.weight.data, model.weight_type = weights.index, weights.weight, dtype
    return model


@pytest.mark.parametrize("dtype", [*TYPES, torch.float32], ids=str)
def test_a_file_gives_the_same_model_and_the_same_file(tmp_path: Path, dtype: torch.dtype) -> None:
    model = stored_model(dtype)
    (tmp_path / tensor_file.MODEL_FILE).write_bytes(model.pack())
    loaded = SPMM.load(tmp_path)
    assert loaded.weight_type == dtype
    theirs = loaded.state_dict()
    for name, tensor in model.state_dict().items():
        assert theirs[name].dtype == tensor.dtype
        assert torch.equal(theirs[name], tensor), name
    wi, wo = (random_directions(50, seed, dtype=torch.float32) for seed in (1, 2))
    uv = torch.rand(50, 2, generator=torch.Generator().manual_seed(3))
    assert torch.equal(loaded(uv, wi, wo), model(uv, wi, wo))
    assert loaded.pack() == model.pack()


def test_weights_that_were_not_rounded_are_saved_all_the_same() -> None:
    """As after an edit: the file then holds what `rounded` tells."""
    model = stored_model(torch.uint8)
    model.weight.data *= torch.linspace(0.3, 1.0, len(model.weight))[:, None]
    loaded = SPMM.from_tensors(*model.to_tensors())
    assert torch.equal(loaded.weight, rounded(model.sparse_weights, torch.uint8).weight)
    torch.testing.assert_close(loaded.weight, model.weight, rtol=0.03, atol=1e-5)


def test_versions_are_as_low_as_they_can_be() -> None:
    plain = planted_model(rings=FEW_RINGS, residual=0.05)
    plain.horizon = 0.0
    version = {
        "none": plain,
        "components": with_components(plain, 2),
        "codes": stored_model(torch.uint8),
    }
    assert [m.to_tensors()[1].get("version", "1") for m in version.values()] == ["1", "2", "2"]
    assert b'"version":"1"' in plain.pack()
    assert b'"version":"2"' in version["components"].pack()


def test_bytes_of_a_texel_do_not_count_what_texels_share() -> None:
    """Entries, labels, counts and coefficients, and the header of the file."""
    model = stored_model(torch.uint8)
    header = int.from_bytes(model.pack()[:8], "little") + 8
    texels, entry_bytes = model.texel_count, 1 + 3
    expected = (header + len(model.index) * entry_bytes + texels * (1 + 1 + 2)) / texels
    assert model.bytes_per_texel() == pytest.approx(expected)
    assert model.byte_counts()["residual"] > 2 * len(model.view) * len(model.light) * 3


def test_texels_keep_their_own_entries() -> None:
    model = stored_model(torch.uint8)
    loaded = SPMM.from_tensors(*model.to_tensors())
    assert torch.equal(entry_texels(loaded), entry_texels(model))
