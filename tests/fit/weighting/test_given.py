"""Weights that settings name, and those that compress."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch import BTF
from spmm_torch.config.fit import WeightsConfig
from spmm_torch.errors import DataError
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.weighting import compressive_weights, given_weights
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((0.0, 1), (45.0, 6)))
COUNT, HEIGHT, WIDTH = len(DIRECTIONS), 2, 3
CPU = torch.device("cpu")
SCENE = "{shape: plane, camera: orthographic, lights: ['directional:45,0'], size: 16}"


@pytest.fixture(scope="module")
def btf() -> BTF:
    """Pairs of very different size, texels of nearly the same."""
    generator = torch.Generator().manual_seed(0)
    size = 10.0 ** (4.0 * torch.rand(COUNT, COUNT, generator=generator) - 4.0)
    noise = 0.9 + 0.2 * torch.rand(COUNT, COUNT, HEIGHT, WIDTH, 3, generator=generator)
    return BTF.from_values(size[..., None, None, None] * noise, DIRECTIONS, DIRECTIONS)


def save(path: Path, **arrays: np.ndarray) -> str:
    np.savez(path, **arrays)
    return str(path)


def test_nothing_is_named(btf: BTF) -> None:
    assert given_weights(btf, WeightsConfig()).uniform


def test_a_file_and_a_scene_multiply(btf: BTF, tmp_path: Path) -> None:
    pair = np.random.default_rng(0).random((COUNT, COUNT))
    file = save(tmp_path / "w.npz", pair=pair)
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    of_file = given_weights(btf, WeightsConfig(file=file, floor=0.0))
    torch.testing.assert_close(of_file.pair, torch.from_numpy(pair / pair.mean()).float().flatten())
    assert of_file.texel is None
    of_scene = given_weights(btf, WeightsConfig(scene=str(scene), floor=0.0))
    both = given_weights(btf, WeightsConfig(scene=str(scene), file=file, floor=0.0))
    product = of_file.pair * of_scene.pair
    torch.testing.assert_close(both.pair, product / product.mean())
    floored = given_weights(btf, WeightsConfig(scene=str(scene), floor=0.2))
    torch.testing.assert_close(floored.pair, 0.2 + 0.8 * of_scene.pair)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"pairs": np.ones((2, 2))}, "has neither 'pair' nor 'texel'"),
        ({"pair": np.ones((2, 2))}, "has shape [2, 2]; expected [7, 7]"),
        ({"texel": np.ones((3, 2))}, "has shape [3, 2]; expected [2, 3]"),
        ({"pair": np.zeros((COUNT, COUNT))}, "is 0 wherever"),
        ({"pair": np.array(["a"])}, "cannot be read"),
        ({"pair": np.array([None])}, "cannot be read"),
    ],
)
def test_bad_files(btf: BTF, tmp_path: Path, arrays: dict[str, np.ndarray], message: str) -> None:
    path = save(tmp_path / "w.npz", **arrays)
    with pytest.raises(DataError) as error:
        given_weights(btf, WeightsConfig(file=path))
    assert message in str(error.value)
    assert path in str(error.value)


@pytest.mark.parametrize("content", [None, b"", b"not a zip"])
def test_no_file(btf: BTF, tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "w.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, match=r"weights .* cannot be read"):
        given_weights(btf, WeightsConfig(file=str(path)))


def test_compressed_errors_count_by_the_slope_squared(btf: BTF) -> None:
    """Against the error of compressed values itself, for small errors of bright pairs."""
    assert compressive_weights(btf, Objective(), CPU).uniform
    size = btf.texels().mean((0, 2)).double()
    bright = size > size.mean()
    y = size[bright]
    for error, compress in (("cube-root", lambda x: x ** (1.0 / 3.0)), ("log", torch.log)):
        weights = compressive_weights(btf, Objective(error), CPU).pair.double()[bright]
        squared = (compress(y * 1.001) - compress(y)).square()
        ratio = weights * (0.001 * y).square() / squared
        torch.testing.assert_close(ratio / ratio.mean(), torch.ones_like(ratio), rtol=0.05, atol=0)


def test_dark_pairs_gain_most_but_not_without_end(btf: BTF) -> None:
    size = btf.texels().mean((0, 2))
    root, log = (
        compressive_weights(btf, Objective(error), CPU).pair for error in ("cube-root", "log")
    )
    order = size.argsort()
    for pair in (root, log):
        assert bool((pair[order].diff() <= 0.0).all())
    assert log.max() / log.min() > root.max() / root.min()
    assert log.max() / log.min() < 1e6
