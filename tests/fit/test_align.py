"""The stage that finds the relief: its modes, what it refuses, what it tells."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch import BTF, FitConfig
from spmm_torch.data.error_weights import UNIFORM
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.fit import fit
from spmm_torch.fit.align import align
from spmm_torch.fit.problem import Problem
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.progress import Progress
from tests.planted.reliefs import planted_relief

SIDE = 32
SMALL = {
    "cluster": {"count": 3},
    "sample": {"per_cluster": 2},
    "search": {
        "models": ["lambertian", "ward"],
        "max_lobes": 2,
        "restarts": 1,
        "bank_normals": 16,
        "exchanges": 0,
    },
    "residual": {"rank": 2},
    "device": "cpu",
}


@pytest.fixture(scope="module")
def btf() -> BTF:
    return planted_relief(size=(SIDE, SIDE)).btf


def aligned(btf: BTF, *assignments: str) -> tuple[Problem, list[str]]:
    """The problem after the stage, and what it said."""
    told = io.StringIO()
    context = Context.build("cpu", progress=Progress(told))
    config = FitConfig().override(list(assignments))
    found = align(Problem.build(btf, UNIFORM, config, context))
    return found, told.getvalue().splitlines()


def test_modes(btf: BTF) -> None:
    off, told = aligned(btf, "relief.mode=off")
    assert off.relief is None and off.btf is btf is off.pictures and told == []
    plane, _ = aligned(btf, "relief.mode=plane")
    assert plane.relief is not None and len(plane.relief.height) == 1
    auto, told = aligned(btf, "relief.mode=auto")
    assert auto.relief is not None and len(auto.relief.height) == SIDE * SIDE
    assert auto.pictures is btf and auto.btf is not btf
    assert auto.btf.texels().shape == btf.texels().shape
    assert sum(line.startswith("relief: heights") for line in told) == 1


def grey(path: Path, height: int, width: int) -> Path:
    levels = np.linspace(0, 255, height * width).reshape(height, width)
    Image.fromarray(levels.astype(np.uint8)).save(path)
    return path


def test_a_given_map_of_another_size_is_refused(btf: BTF, tmp_path: Path) -> None:
    path = grey(tmp_path / "height.png", SIDE, SIDE + 1)
    with pytest.raises(DataError, match="33 x 32 but the pictures of the BTF are 32 x 32"):
        aligned(btf, f"relief.height={path}")


def test_heights_that_no_model_has_are_refused(btf: BTF, tmp_path: Path) -> None:
    path = grey(tmp_path / "height.png", SIDE, SIDE)
    with pytest.raises(ConfigError, match=r"at most 0\.5; lower relief\.height_scale"):
        aligned(btf, f"relief.height={path}", "relief.height_scale=1.0")


def test_one_view_has_no_relief(btf: BTF) -> None:
    view = ring_directions(((0.0, 1),))
    found, told = aligned(planted_relief(size=(SIDE, SIDE), views=view).btf)
    assert found.relief is None
    assert sum("no relief is sought" in line for line in told) == 1


def test_a_flat_surface_stays_flat_and_is_fit_as_well() -> None:
    btf = planted_relief(0.0, 0.0, size=(SIDE, SIDE)).btf
    auto = fit(btf, FitConfig.from_dict(SMALL), render=False)
    off = fit(btf, FitConfig.from_dict({**SMALL, "relief": {"mode": "off"}}), render=False)
    assert auto.model.relief is None
    assert auto.report["snr_db"] == off.report["snr_db"]
    assert auto.model.pack() == off.model.pack()
