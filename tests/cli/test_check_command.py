"""`spmm check`: one page, JSON, and an exit code."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch import BTF
from spmm_torch.cli.main import main
from spmm_torch.geometry.directions import ring_directions
from tests.data.test_picture_set import make_files, write_zip
from tests.planted.runs import save

DIRECTIONS = ring_directions()[:19]


def lambertian(path: Path, cosine: bool) -> Path:
    """A texture of noise, with or without the cosine."""
    texture = torch.rand(20, 20, 3, generator=torch.Generator().manual_seed(0)) * 0.3
    light = DIRECTIONS[:, 2] if cosine else torch.ones(len(DIRECTIONS))
    values = light.view(1, -1, 1, 1, 1) * texture
    return save(BTF.from_values(values.expand(19, -1, -1, -1, -1), DIRECTIONS, DIRECTIONS), path)


def test_a_page_and_a_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = lambertian(tmp_path / "a.npz", cosine=True)
    assert main(["check", str(source)]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == "a: 20 x 20 texels, 19 views, 19 lights"
    assert all(line.startswith(("fine  ", "      ")) for line in lines)
    assert len([line for line in lines if line.startswith("fine")]) == 10


def test_something_to_look_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = lambertian(tmp_path / "a.npz", cosine=False)
    assert main(["check", str(source)]) == 1
    assert "LOOK  cosine" in capsys.readouterr().out
    assert main(["check", str(source), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["input"] == str(source)
    assert found["cosine"]["verdict"] == "look"
    assert found["cosine"]["slope"] == pytest.approx(0.0, abs=1e-3)
    assert "--set data.cosine=missing" in found["cosine"]["says"]
    assert main(["check", str(source), "--set", "data.cosine=missing"]) == 0


def test_gaps_are_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = make_files(np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8))
    del files[5]
    assert main(["check", str(write_zip(tmp_path / "a.zip", files))]) == 1
    assert "LOOK  pairs         1 of 9 pairs have no picture" in capsys.readouterr().out


def test_bad_input(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "does not exist" in refused("check", tmp_path / "none.zip")
    assert "unknown setting data.gama" in refused("check", "x.zip", "--set", "data.gama=1")
