"""The products of a cluster, however its texels are passed over and wherever they lie."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.config.fit import SelectConfig, StagewiseConfig
from spmm_torch.errors import OutputError
from spmm_torch.fit.select.products import RUN, Products, cluster_products
from spmm_torch.fit.select.target import target_beside_residual
from spmm_torch.fit.select.texels import select

TEXELS, ATOMS, PAIRS, CHANNELS = 11, 6, 40, 3
ARRAYS = ("gram", "correlation", "energy", "overlap", "mean", "mean_correlation", "mean_energy")


def case(seed: int = 0) -> tuple[Tensor, Tensor]:
    """Values `[T, D, C]` and atoms of unit norm `[J, D]`."""
    generator = torch.Generator().manual_seed(seed)
    values = torch.rand(TEXELS, PAIRS, CHANNELS, generator=generator)
    atoms = torch.rand(ATOMS, PAIRS, generator=generator)
    return values, atoms / atoms.norm(dim=1, keepdim=True)


def products(parts: list[slice], in_memory: bool = True, seed: int = 0) -> Products:
    values, atoms = case(seed)
    signals = values.transpose(1, 2)
    return cluster_products(
        lambda part: signals[part],
        parts,
        (TEXELS, CHANNELS),
        atoms,
        points=values.flatten(1),  # coordinates that leave nothing out
        in_memory=in_memory,
    )


WHOLE = [slice(0, TEXELS)]


@st.composite
def splits(draw: st.DrawFn) -> list[slice]:
    """Any consecutive blocks of all texels, in any order."""
    cuts = draw(st.sets(st.integers(1, TEXELS - 1)))
    edges = [0, *sorted(cuts), TEXELS]
    parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return draw(st.permutations(parts))


def check_close(found: Products, expected: Products) -> None:
    assert found.count == expected.count == TEXELS
    for name in ARRAYS:
        torch.testing.assert_close(
            getattr(found, name).float(), getattr(expected, name).float(), rtol=2e-6, atol=1e-6
        )


def test_products_are_the_sums_written_out() -> None:
    values, atoms = (part.double() for part in case())
    mean = values.mean(0)
    expected = {
        "gram": atoms @ atoms.T,
        "correlation": torch.einsum("jd,tdc->tjc", atoms, values),
        "energy": values.square().sum(1),
        "overlap": (values * mean).sum((1, 2)),
        "mean": mean,
        "mean_correlation": atoms @ mean,
        "mean_energy": mean.square().sum(0),
    }
    found = products(WHOLE)
    assert found.count == TEXELS
    for name in ARRAYS:
        torch.testing.assert_close(getattr(found, name).double(), expected[name], rtol=1e-5, atol=0)


@given(splits(), st.booleans())
def test_any_blocks_give_the_same(parts: list[slice], in_memory: bool) -> None:
    check_close(products(parts, in_memory), products(WHOLE))


@given(splits())
def test_scratch_file_gives_the_same_bits(parts: list[slice]) -> None:
    inside, outside = products(parts), products(parts, in_memory=False)
    for name in ARRAYS:
        assert torch.equal(getattr(inside, name), getattr(outside, name))


def test_selection_from_a_scratch_file() -> None:
    """It is read in parts, whose sums stay in memory."""
    fits = []
    for in_memory in (True, False):
        part = products(WHOLE, in_memory).part(slice(2, 9))
        target = target_beside_residual(part, None, 0.5)
        fits.append(select(part, target, SelectConfig(), StagewiseConfig()))
    assert torch.equal(fits[0].index, fits[1].index)
    assert torch.equal(fits[0].weights, fits[1].weights)


def test_overlap_by_few_coordinates() -> None:
    """What they leave out is known on average, and small in every texel."""
    values, atoms = case()
    flat = values.flatten(1)
    axes = torch.linalg.svd(flat, full_matrices=False).Vh[:3]
    found = cluster_products(
        lambda part: values.transpose(1, 2)[part],
        WHOLE,
        (TEXELS, CHANNELS),
        atoms,
        points=flat @ axes.T,
    ).overlap
    expected = flat.double() @ flat.double().mean(0)
    torch.testing.assert_close(found.sum(), expected.sum(), rtol=1e-6, atol=0)
    torch.testing.assert_close(found, expected, rtol=0.01, atol=0)


def test_each_block_is_loaded_once() -> None:
    values, atoms = case()
    for parts in (WHOLE, [slice(0, 4), slice(4, TEXELS)]):
        loaded: list[slice] = []

        def load(part: slice, loaded: list[slice] = loaded) -> Tensor:
            loaded.append(part)
            return values.transpose(1, 2)[part]

        cluster_products(load, parts, (TEXELS, CHANNELS), atoms)
        assert loaded == parts


def test_no_atoms() -> None:
    """A cluster whose samples are black has an empty dictionary."""
    values, atoms = case()
    for in_memory in (True, False):
        found = cluster_products(
            lambda part: values.transpose(1, 2)[part],
            WHOLE,
            (TEXELS, CHANNELS),
            atoms[:0],
            in_memory=in_memory,
        )
        assert found.correlation.shape == (TEXELS, 0, CHANNELS)
        torch.testing.assert_close(found.energy, products(WHOLE).energy)


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def fail(descriptor: int, offset: int, size: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", fail)
    yield


@pytest.mark.usefixtures("full_disk")
def test_full_scratch_disk_is_one_sentence() -> None:
    with pytest.raises(OutputError, match="scratch space cannot be had in .* set TMPDIR"):
        products(WHOLE, in_memory=False)


def test_scratch_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    found = products(WHOLE, in_memory=False)
    assert list(tmp_path.iterdir()) == []
    check_close(found, products(WHOLE))


@pytest.mark.parametrize("pairs", [1, RUN - 1, RUN, 2 * RUN, 40 * RUN + 7])
def test_energy_of_many_pairs_is_nearly_that_of_float64(pairs: int) -> None:
    """One float32 sum of 20,487 equal squares is off by some 4e-5."""
    values = torch.full((2, CHANNELS, pairs), 0.3) + 0.1 * torch.arange(2)[:, None, None]
    atoms = torch.ones(1, pairs) / pairs**0.5
    found = cluster_products(lambda part: values[part], [slice(0, 2)], (2, CHANNELS), atoms)
    expected = values.double().square().sum(-1)
    torch.testing.assert_close(found.energy, expected, rtol=2e-6, atol=0.0)
