"""The command that makes a full-sized file, at a small size."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from spmm_torch.data import ubo2014
from tests.data.ubo2014.independent_reader import load
from tests.synthetic.btf_factors import main, write_synthetic


def test_command(tmp_path: Path) -> None:
    path = tmp_path / "a.btf"
    assert main([str(path), "--size", "12", "--components", "9", "--scalar", "2"]) == 0
    btf = ubo2014.read(path).load()
    assert (btf.height, btf.width, btf.pair_count) == (12, 12, 151 * 151)
    assert len(load(path.read_bytes()).singular_values[0]) == 9
    values = btf.texels(torch.arange(0, 144, 7))
    assert float((values == 0).float().mean()) < 0.02
    assert 0.05 < float(values.mean()) < 0.5
    assert float(values.std(dim=0).mean()) > 0.01


def test_seed(tmp_path: Path) -> None:
    contents = []
    for seed in (1, 1, 2):
        write_synthetic(tmp_path / "a.btf", size=4, components=7, seed=seed, rings="ubo2003")
        contents.append((tmp_path / "a.btf").read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "no" / "a.btf"), "--size", "4", "--rings", "ubo2003"]) == 2
    assert capsys.readouterr().err.startswith("error: ")
