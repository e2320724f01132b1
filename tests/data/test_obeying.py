"""Settings of a fit are obeyed by a BTF that was opened without them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch import BTF, FitConfig
from spmm_torch.config.fit import DataConfig
from spmm_torch.data import load_btf, load_input, obeying
from spmm_torch.errors import ConfigError
from spmm_torch.fit import fit
from spmm_torch.geometry.directions import ring_directions
from tests.data.test_negative import LIGHT, NOISY, VIEW
from tests.data.test_picture_set import make_files, write_zip
from tests.planted.settings import FLAT

WAYS = (
    DataConfig(gamma=1.0),
    DataConfig(cosine="missing"),
    DataConfig(missing="mask"),
    DataConfig(crop=(1, 0, 3, 2)),
    DataConfig(texels=6),
    DataConfig(directions="2"),
    DataConfig(gamma=1.0, cosine="missing", missing="mask", texels=6, directions="views=0-1"),
)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    codes = np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
    return write_zip(tmp_path / "a.zip", make_files(codes))


def values(btf: BTF) -> np.ndarray:
    return btf.texels().numpy()


@pytest.mark.parametrize("settings", WAYS)
def test_settings_are_obeyed(source: Path, settings: DataConfig) -> None:
    wanted = values(load_input(source, settings, 4))
    opened = load_btf(source)
    assert np.array_equal(values(obeying(opened, settings, 4)), wanted)
    assert np.array_equal(values(obeying(opened.load(), settings, 4)), wanted)


@pytest.mark.parametrize("settings", WAYS)
def test_a_btf_that_was_read_by_them_stays(source: Path, settings: DataConfig) -> None:
    btf = load_input(source, settings, 4)
    assert obeying(btf, settings, 4) is btf
    assert obeying(btf, DataConfig(), 4) is btf


def test_a_part_stays_a_part(source: Path) -> None:
    part = load_btf(source).restricted(torch.tensor([3, 1]), (1, 2), views=torch.tensor([2, 0]))
    now = obeying(part, DataConfig(gamma=1.0, cosine="missing"))
    assert torch.equal(now.view, part.view)
    cosine = part.light[:, 2].repeat(2)[:, None]
    wanted = values(part) ** (1.0 / 2.2) * cosine.numpy()
    assert np.allclose(values(now), wanted, atol=1e-6)
    with pytest.raises(ConfigError, match=r"data\.crop is .* the BTF is a part of a already"):
        obeying(part, DataConfig(crop=(0, 0, 1, 1)))


@pytest.mark.parametrize("negative", ["clip", "keep"])
def test_a_fit_treats_negative_values_as_its_settings_say(tmp_path: Path, negative: str) -> None:
    np.savez(tmp_path / "noisy.npz", values=NOISY, view=VIEW, light=LIGHT)
    config = FitConfig.from_dict(
        {"data": {"negative": negative}, "search": {"models": ["lambertian"]}, **FLAT}
    )
    given = fit(load_btf(tmp_path / "noisy.npz"), config, render=False)
    known = fit(load_btf(tmp_path / "noisy.npz", negative=negative), config, render=False)
    assert given.report["snr_db"] == known.report["snr_db"]
    assert given.model.pack() == known.model.pack()


def test_values_in_memory_obey_too() -> None:
    directions = ring_directions()[:3]
    btf = BTF.from_values(np.abs(NOISY[:, :, :1, :2]), directions[:2], directions)
    assert obeying(btf, replace(DataConfig(), gamma=1.0, missing="mask")) is btf
    now = obeying(btf, DataConfig(cosine="missing"))
    assert torch.allclose(now.texels(), btf.texels() * directions[:, 2].repeat(2)[:, None])
