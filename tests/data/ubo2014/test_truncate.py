"""What truncated factors leave out, and the fewest that reach a ratio."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, load_btf
from spmm_torch.data.ubo2014 import factorize as module
from spmm_torch.data.ubo2014 import truncate
from spmm_torch.errors import ConfigError
from tests.data.ubo2014.independent_reader import load
from tests.data.ubo2014.planted import random_btf

VARIANTS = ["DFMF08FC", "FMF06FC"]


def ratios(btf: BTF, joint: bool) -> np.ndarray:
    """Signal-to-noise ratios in dB of 0, 1, ... components, by LAPACK."""
    values = btf.texels().double().numpy()
    parts = [values.reshape(len(values), -1)] if joint else list(np.moveaxis(values, -1, 0))
    squares = sum(np.linalg.svd(part, compute_uv=False) ** 2 for part in parts)
    left_out = np.append(np.cumsum(squares[::-1])[::-1], 0.0)
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(squares.sum() / left_out)


@pytest.mark.parametrize("components", [1, 4, 7])
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_ratio_is_that_of_the_file(tmp_path: Path, variant: str, components: int) -> None:
    btf = random_btf()
    found = truncate(btf, components=components, variant=variant, scalar=8)
    expected = ratios(btf, joint=variant != "DFMF08FC")[components]
    assert found.components == components
    assert found.snr_db == pytest.approx(expected, abs=1e-6)
    found.write(tmp_path / "a.btf")
    values = load((tmp_path / "a.btf").read_bytes()).values()
    values = values * btf.light[:, 2].double().numpy()[:, None, None, None]
    exact = np.stack([btf.pictures(view).double().numpy() for view in range(len(btf.view))])
    ratio = 10.0 * math.log10((exact**2).sum() / ((exact - values) ** 2).sum())
    assert ratio == pytest.approx(expected, abs=1e-5)
    error = (load_btf(tmp_path / "a.btf").texels() - btf.texels()).double().square().sum()
    read = 10.0 * math.log10(float(btf.texels().double().square().sum() / error))
    assert read >= found.snr_db - 1e-6  # values below zero are clipped


@pytest.mark.parametrize("most", [1, 2, 100])
@pytest.mark.parametrize("snr", [0.0, 8.0, 12.0, 40.0, 60.0])
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_fewest_components_of_a_ratio(
    monkeypatch: pytest.MonkeyPatch, variant: str, snr: float, most: int
) -> None:
    monkeypatch.setattr(module, "DEFAULT_COMPONENTS", most)  # where the doubling begins
    btf = random_btf()
    found = truncate(btf, snr=snr, variant=variant, scalar=8)
    exact = ratios(btf, joint=variant != "DFMF08FC")
    assert found.components == max(int(np.argmax(exact >= snr)), 1)
    assert found.snr_db >= snr


def test_progress_of_several_tries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "DEFAULT_COMPONENTS", 4)
    told = []
    truncate(random_btf(), snr=40.0, progress=lambda *call: told.append(call))
    assert [done for done, _ in told] == list(range(30, 30 * len(told) + 1, 30))
    assert told[3] == (120, 120) and told[-1][0] == told[-1][1] > 120


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"snr": 20.0, "components": 3}, "components is 3 and snr is 20; expected one of them"),
        ({"snr": 20.0, "colour_model": 11}, "snr is 20 for a file of colour model 11"),
        (
            {"snr": 20.0, "variant": "FMF12FCE", "log_values": True},
            "snr is 20 for a file of .* logarithms",
        ),
        (
            {"snr": 400.0},
            r"snr is 400 dB; expected 1\d\d\.\d at most, which all 12 components of r",
        ),
        ({"rows": "left"}, "rows is 'left'; expected top or bottom"),
    ],
)
def test_settings_that_mean_nothing(settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        truncate(random_btf(), **settings)


def test_ratios_of_logarithms_are_not_told() -> None:
    assert truncate(random_btf(), colour_model=11).snr_db is None


def test_values_of_any_size_have_a_ratio() -> None:
    btf = random_btf()
    scaled = BTF.from_values(
        np.stack([1e15 * btf.pictures(view).numpy() for view in range(3)]), btf.view, btf.light
    )
    found, expected = (truncate(each, components=5).snr_db for each in (scaled, btf))
    assert found == pytest.approx(expected, abs=1e-3)
    assert torch.isfinite(scaled.texels()).all()
