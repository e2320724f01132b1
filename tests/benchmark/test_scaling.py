"""Larger inputs are what they should be, and exponents those of planted times."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.benchmark import scaling
from spmm_torch.benchmark.materials import DARKEST, tiled, with_directions
from spmm_torch.benchmark.scaling import cases, exponent, exponents
from spmm_torch.benchmark.scope import FULL, Bench
from spmm_torch.data import BTF
from spmm_torch.data.store import Loading
from spmm_torch.geometry.directions import ring_directions

CPU = torch.device("cpu")
RINGS = ((0.0, 1), (30.0, 6), (60.0, 8))


def base(btf: BTF) -> object:
    """The values of a BTF."""
    return btf.open_store(btf.part, Loading())


def test_tiles_are_the_input_with_gains(planted_btf: BTF) -> None:
    large = tiled(planted_btf, base(planted_btf), 16 * 16)
    assert (large.height, large.width) == (16, 16)
    row, column = 11, 7
    chosen = large.texels(torch.tensor([row * 16 + column]))
    source = planted_btf.texels(torch.tensor([(row % 6) * 6 + column % 6]))
    gain = chosen.sum((0, 1)) / source.sum((0, 1))  # [C]
    assert torch.allclose(chosen, source * gain, rtol=1e-5)
    assert ((gain >= DARKEST - 1e-5) & (gain <= 1.0 + 1e-5)).all()


def test_no_two_repeats_are_alike(planted_btf: BTF) -> None:
    large = tiled(planted_btf, base(planted_btf), 24 * 24)
    values = large.texels()
    assert torch.equal(large.picture(2, 3).flatten(0, 1), values[:, 2 * 15 + 3])
    distance = torch.cdist(values.flatten(1), values.flatten(1)).fill_diagonal_(torch.inf)
    assert distance.min() > 0.0


def test_the_same_directions_give_the_same_values(planted_btf: BTF) -> None:
    same = with_directions(planted_btf, RINGS)
    assert torch.equal(same.light, ring_directions(RINGS))
    assert torch.allclose(same.texels(), planted_btf.texels(), atol=2e-3)


def test_other_directions_are_between_their_neighbours(planted_btf: BTF) -> None:
    finer = with_directions(planted_btf, ((0.0, 1), (15.0, 6), (30.0, 6), (60.0, 8)))
    assert finer.pair_count == 21 * 21
    assert finer.texels().min() >= 0.0
    assert finer.texels().max() <= planted_btf.texels().max() * 1.001


def test_the_exponent_of_planted_times() -> None:
    sizes = [10, 100, 1000]
    assert exponent(sizes, [0.3 * size**1.5 for size in sizes]) == pytest.approx(1.5)
    assert exponent(sizes, [2.0, 2.0, 2.0]) == pytest.approx(0.0, abs=1e-9)


def test_no_exponent_of_what_is_too_fast() -> None:
    assert exponent([1, 10], [0.0, 0.0]) is None
    assert exponent([1, 10, 100], [1e-4, 1e-3, 7.0]) is None
    assert exponent([10, 10], [1.0, 2.0]) is None


def test_exponents_of_each_kind_apart() -> None:
    def row(varies: str, threads: int, size: int, seconds: float) -> dict[str, object]:
        return {
            "varies": varies,
            "device": "cpu",
            "threads": threads,
            "texels": size if varies == "texels" else 5,
            "direction_pairs": 7 if varies == "texels" else size,
            "seconds": {"total": seconds},
        }

    rows = [row("texels", 2, 10, 1.0), row("texels", 2, 100, 10.0)]
    rows += [row("texels", 1, 10, 1.0), row("texels", 1, 100, 100.0)]
    rows += [row("directions", 2, 4, 1.0), row("directions", 2, 16, 1.0)]
    found = exponents(rows)
    assert [row["power"]["total"] for row in found] == pytest.approx([1.0, 2.0, 0.0])


def test_the_full_scope_has_small_and_large_materials() -> None:
    found = cases(FULL, [CPU], threads=2)
    assert {case.texels for case in found if case.varies == "texels"} >= {1024, 65536}
    assert {case.threads for case in found} == {1, 2}
    pairs = [sum(count for _, count in case.rings) ** 2 for case in found if case.rings]
    assert sorted(pairs) == [81**2, 151**2]


def test_a_measured_row(bench: Bench, planted_btf: BTF) -> None:
    case = scaling.Case("texels", 49, None, CPU, 1)
    btf = scaling._material(bench, planted_btf, base(planted_btf), case)
    row = scaling._measured(case, btf, scaling.shipped("smoke", bench.scope.overrides))
    assert (row["texels"], row["threads"]) == (49, 1)
    assert row["seconds"]["total"] > 0.0
