"""Scattered samples as lists of pairs: whose they are, what they hold, and what needs a grid."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch import BTF
from spmm_torch.data import Selection, load_btf
from spmm_torch.data.scattered_btf import ScatteredBTF, spread_directions
from spmm_torch.data.units import unit_of
from spmm_torch.errors import DataError
from tests.planted.scattered import planted_values, random_pairs, save_samples


def opened(path: Path, **changes: object) -> ScatteredBTF:
    btf = load_btf(path, **changes)
    assert isinstance(btf, ScatteredBTF)
    return btf


@pytest.mark.parametrize("shared", [False, True])
def test_each_texel_has_its_own_samples(tmp_path: Path, shared: bool) -> None:
    btf = opened(save_samples(tmp_path / "a.npz", 3, 40, shared=shared))
    assert len(btf.lists) == (1 if shared else 3)
    assert (btf.pair_count, btf.value_count, btf.texel_count) == (40, 3 * 40 * 3, 3)
    for texel in range(3):
        wi, wo, values = btf.samples(texel)
        assert len(wi) == 40
        torch.testing.assert_close(values, planted_values(wi, wo, texel), rtol=1e-4, atol=1e-5)


def test_a_pair_that_is_listed_again_is_averaged(tmp_path: Path) -> None:
    wi, wo = (side.numpy() for side in random_pairs(30, 1))
    rgb = np.ones((30, 3), np.float32)
    arrays = {"wi": np.tile(wi, (2, 1)), "wo": np.tile(wo, (2, 1))}
    np.savez(tmp_path / "a.npz", rgb=np.concatenate((rgb, 3.0 * rgb)), **arrays)
    btf = opened(tmp_path / "a.npz")
    assert btf.lists[0].values.equal(torch.full((1, 30, 3), 2.0))


def test_the_cosine_and_the_unit(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 2, 30)
    plain, times = opened(path), opened(path, cosine="missing")
    for one, two in zip(plain.lists, times.lists, strict=True):
        torch.testing.assert_close(two.values, one.values * one.wi[:, 2:])
    tiny = plain.scaled(2.0**-40)
    assert unit_of(tiny) * tiny.level() == pytest.approx(0.5, rel=0.5)
    with pytest.raises(DataError, match="as highest value; expected one from 1e-30"):
        unit_of(plain.scaled(2.0**-135))
    hot = opened(save_samples(tmp_path / "b.npz", 2, 500))
    hot.lists[1].values[0, 3, 0] = 1e30
    with pytest.raises(DataError, match=r"holds 1e\+30 at 'texel 1', light \(.*mend that hot"):
        unit_of(hot)


def test_values_below_zero_are_as_the_settings_say(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 2, 30)
    with np.load(path) as file:
        arrays = dict(file)
    arrays["rgb"][35] = -1.0
    np.savez(path, **arrays)
    with pytest.raises(DataError, match="holds -1 at 'texel 1', light .* data.negative as clip"):
        opened(path).load()
    assert min(float(part.values.min()) for part in opened(path, negative="clip").lists) == 0.0
    assert min(float(part.values.min()) for part in opened(path, negative="keep").lists) == -1.0


def test_some_texels(tmp_path: Path) -> None:
    path = save_samples(tmp_path / "a.npz", 6, 20, size=np.array([2, 3]))
    part = load_btf(path, selection=Selection(crop=(1, 0, 2, 2)))
    assert (part.height, part.width) == (2, 2)
    for place, texel in enumerate((1, 2, 4, 5)):
        assert part.samples(place)[2].equal(load_btf(path).samples(texel)[2])


@pytest.mark.parametrize(
    "work",
    [
        lambda btf: btf.pairs(),
        lambda btf: btf.texels(),
        lambda btf: btf.signals(),
        lambda btf: btf.picture(0, 0),
        lambda btf: btf.pictures(0),
        lambda btf: btf.restricted(views=torch.tensor([0])),
    ],
)
def test_what_needs_a_grid_says_so(tmp_path: Path, work: Callable[[BTF], object]) -> None:
    btf = opened(save_samples(tmp_path / "a.npz", 2, 20))
    with pytest.raises(DataError, match=r"a.npz holds scattered samples, .* needs a grid of light"):
        work(btf)


def test_directions_that_stand_for_all_have_the_lowest_and_are_far_apart() -> None:
    directions, _ = random_pairs(3000, 3)
    some = spread_directions(directions, 40)
    assert len(some) == 40
    assert some[:, 2].min() == directions[:, 2].min()
    away = torch.cdist(some, some).fill_diagonal_(9.0).min()
    assert away > 0.15
    assert len(spread_directions(directions[:1].expand(5, 3))) == 1


def test_samples_from_python() -> None:
    wi, wo = random_pairs(40, 1)
    values = planted_values(wi, wo)[None]
    btf = ScatteredBTF.from_samples(wi, wo.tolist(), values.numpy(), name="wax")
    assert (btf.name, btf.texel_count, len(btf.lists)) == ("wax", 1, 1)
    assert btf.samples(0)[2].equal(values[0])
    assert btf.identity() != ScatteredBTF.from_samples(wi, wo, 2.0 * values).identity()
    with pytest.raises(DataError, match=r"values \[1, 40, 3\] at 40 lights and 30 views"):
        ScatteredBTF.from_samples(wi, wo[:30], values)
