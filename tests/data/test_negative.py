"""Values below zero, as dark-frame subtraction leaves them: refused, clipped or kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.cli.main import main
from spmm_torch.data import BTF, ReadOptions, load_btf
from spmm_torch.data.writers import write_exr_folder
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.geometry.directions import ring_directions

VIEW = ring_directions()[[0, 3]].numpy()
LIGHT = ring_directions()[[1, 8, 40]].numpy()
NOISY = np.random.default_rng(0).normal(0.1, 0.2, (2, 3, 4, 5, 3)).astype(np.float32)
TEXELS = torch.from_numpy(NOISY.transpose(2, 3, 0, 1, 4).reshape(20, 6, 3).copy())
WANTED = {"clip": TEXELS.clamp(min=0.0), "keep": TEXELS}


@pytest.fixture(params=["npz", "exr"])
def noisy(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "npz":
        np.savez(tmp_path / "noisy.npz", values=NOISY, view=VIEW, light=LIGHT)
        return tmp_path / "noisy.npz"
    btf = BTF.from_values(NOISY, VIEW, LIGHT, name="noisy", negative="keep")
    write_exr_folder(tmp_path / "noisy", btf)
    return tmp_path / "noisy"


def test_refused_by_default(noisy: Path) -> None:
    with pytest.raises(DataError, match="-0.* at .*expected finite values that are not negative"):
        load_btf(noisy).load()


@pytest.mark.parametrize("negative", ["clip", "keep"])
def test_clipped_or_kept(noisy: Path, negative: str) -> None:
    values = load_btf(noisy, negative=negative).texels()
    assert torch.equal(values, WANTED[negative])


@pytest.mark.parametrize("negative", ["clip", "keep"])
def test_the_same_in_memory(negative: str) -> None:
    btf = BTF.from_values(NOISY, VIEW, LIGHT, negative=negative)
    assert torch.equal(btf.texels(), WANTED[negative])


def test_the_cache_keeps_them_apart(noisy: Path, tmp_path: Path) -> None:
    for negative in ("keep", "clip", "keep"):
        btf = load_btf(noisy, negative=negative).load(cache=tmp_path / "cache")
        assert torch.equal(btf.texels(), WANTED[negative])
    with pytest.raises(DataError, match="not negative"):
        load_btf(noisy).load(cache=tmp_path / "cache")


@pytest.mark.parametrize("negative", ["clip", "keep"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_always_refused(negative: str, value: float) -> None:
    broken = NOISY.copy()
    broken[1, 2, 3, 4, 0] = value
    with pytest.raises(DataError, match=r"(nan|inf) at \[view 1, light 2.*mend or replace"):
        BTF.from_values(broken, VIEW, LIGHT, negative=negative)


def test_other_words_are_refused() -> None:
    with pytest.raises(ConfigError, match="negative is 'ignore'; expected one of refuse, clip"):
        ReadOptions(negative="ignore")
    with pytest.raises(ConfigError, match="negative is 'ignore'"):
        BTF.from_values(NOISY, VIEW, LIGHT, negative="ignore")


def test_nothing_but_noise_below_zero_is_black() -> None:
    with pytest.raises(DataError, match="all black"):
        BTF.from_values(-np.abs(NOISY), VIEW, LIGHT, negative="clip")


def test_convert(noisy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["convert", str(noisy), "-o", str(tmp_path / "a.npz")]) == 2
    assert "negative= of load_btf" in capsys.readouterr().err
    assert not (tmp_path / "a.npz").exists()
    assert main(["convert", str(noisy), "-o", str(tmp_path / "a.npz"), "--negative", "clip"]) == 0
    assert torch.equal(load_btf(tmp_path / "a.npz").texels(), WANTED["clip"])
