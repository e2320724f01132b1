"""Pairs of directions without a picture, masked where that is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.errors import ConfigError, DataError
from tests.data.test_picture_set import make_files, write_zip


def pictures() -> list[tuple[str, bytes]]:
    """Members of a zip of 3 views and 3 lights."""
    return make_files(np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8))


def test_missing_pairs_are_masked(tmp_path: Path) -> None:
    files = pictures()
    gone = [5, 7]  # (view 1, light 2), (view 2, light 1)
    whole = load_btf(write_zip(tmp_path / "whole.zip", files))
    kept = [file for place, file in enumerate(files) if place not in gone]
    btf = load_btf(write_zip(tmp_path / "part.zip", kept), missing="mask")
    assert torch.nonzero(btf.missing.flatten()).squeeze(1).tolist() == gone
    assert (btf.pair_count, btf.measured_count) == (9, 7)
    assert torch.equal(btf.texels()[:, btf.measured], whole.texels()[:, btf.measured])
    assert not btf.texels()[:, gone].any()
    assert btf.raw_bytes * 9 == whole.raw_bytes * 7
    assert load_btf(tmp_path / "whole.zip", missing="mask").missing is None


def test_a_part_knows_its_missing_pairs(tmp_path: Path) -> None:
    files = pictures()
    del files[5]  # view 1, light 2
    btf = load_btf(write_zip(tmp_path / "a.zip", files), missing="mask")
    views, lights = torch.tensor([2, 1]), torch.tensor([2, 0])
    part = btf.restricted(views=views, lights=lights)
    assert part.missing.tolist() == [[False, False], [True, False]]
    assert not part.texels()[:, 2].any()
    assert bool((part.texels()[:, [0, 1, 3]].amax((0, 2)) > 0.0).all())
    assert btf.restricted(views=torch.tensor([0, 2])).missing is None
    with pytest.raises(DataError, match="all pairs of the chosen directions are missing"):
        btf.restricted(views=torch.tensor([1]), lights=torch.tensor([2]))


def test_the_cache_knows_where_gaps_are(tmp_path: Path) -> None:
    files = pictures()
    del files[5]  # view 1, light 2
    btf = load_btf(write_zip(tmp_path / "a.zip", files), missing="mask")
    light, cache = torch.tensor([2]), tmp_path / "cache"
    for views in ([0, 1], [1, 0]):  # the same picture before and behind the gap
        part = btf.restricted(views=torch.tensor(views), lights=light)
        values = part.load(cache=cache).texels()
        assert bool(values[:, views.index(0)].any())
        assert not values[:, views.index(1)].any()


def test_unknown_way_with_missing_pairs(tmp_path: Path) -> None:
    files = pictures()
    with pytest.raises(ConfigError, match="missing is 'fill'; expected one of refuse, mask"):
        load_btf(write_zip(tmp_path / "a.zip", files), missing="fill")
