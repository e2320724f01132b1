"""The factor store: same bits however it is asked, part of a file for part of the cost."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, ubo2014
from spmm_torch.data.ubo2014 import product
from spmm_torch.data.ubo2014 import store as module
from spmm_torch.errors import DataError
from tests.data.ubo2014.independent_reader import sections
from tests.synthetic.btf_factors import RINGS, ring_angles

Make = Callable[..., Path]
WIDTH, HEIGHT, COMPONENTS = 13, 17, 7


@pytest.fixture(scope="module", params=["DFMF08FC", "FMF12FCE"])
def path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of several tiles in both directions: 221 texels, 6,561 pairs."""
    random = np.random.default_rng(1)
    angles = ring_angles(RINGS["ubo2003"])
    separate = request.param == "DFMF08FC"
    pairs = len(angles) ** 2 * (1 if separate else 3)
    count = 3 if separate else 1
    parts = sections(
        request.param,
        [random.normal(0.0, 0.3, (pairs, COMPONENTS)) for _ in range(count)],
        [random.normal(0.0, 0.3, (WIDTH * HEIGHT, COMPONENTS)) for _ in range(count)],
        view=angles,
        light=angles,
        width=WIDTH,
        height=HEIGHT,
        colour_model=11,
        reduced=1,
    )
    destination = tmp_path_factory.mktemp("store") / "random.btf"
    destination.write_bytes(b"".join(parts.values()))
    return destination


@pytest.fixture(scope="module")
def btf(path: Path) -> BTF:
    return ubo2014.read(path).load()


@pytest.fixture(scope="module")
def whole(btf: BTF) -> torch.Tensor:
    return btf.texels()


@pytest.mark.parametrize("size", [1, 2, 5, 63, 64, 65, 100])
def test_values_do_not_depend_on_their_block(btf: BTF, whole: torch.Tensor, size: int) -> None:
    blocks = [btf.texels(slice(i, i + size)) for i in range(0, btf.texel_count, size)]
    assert torch.equal(torch.cat(blocks), whole)


def test_any_index(btf: BTF, whole: torch.Tensor) -> None:
    generator = torch.Generator().manual_seed(0)
    index = torch.randint(btf.texel_count, (300,), generator=generator)  # with repeats
    assert torch.equal(btf.texels(index), whole[index])
    mask = torch.rand(btf.texel_count, generator=generator) < 0.2
    assert torch.equal(btf.texels(mask), whole[mask])
    assert btf.texels(index[:0]).shape == (0, btf.pair_count, 3)
    assert whole.is_contiguous()
    with pytest.raises(IndexError):
        btf.texels(torch.tensor([btf.texel_count]))


def test_small_reads(monkeypatch: pytest.MonkeyPatch, path: Path, whole: torch.Tensor) -> None:
    monkeypatch.setattr(module, "READ_TEXELS", 50)
    assert torch.equal(ubo2014.read(path).texels(), whole)


def test_small_tiles(monkeypatch: pytest.MonkeyPatch, path: Path, whole: torch.Tensor) -> None:
    monkeypatch.setattr(product, "CPU_TILE", (32, 100))
    torch.testing.assert_close(ubo2014.read(path).texels(), whole)


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (6560, 6561), (100, 181), (2040, 2060)])
def test_pairs(btf: BTF, whole: torch.Tensor, start: int, stop: int) -> None:
    part = whole[:, start:stop]
    torch.testing.assert_close(btf._store.pairs(start, stop), part)


def test_threads_share_a_store(path: Path, whole: torch.Tensor) -> None:
    btf = ubo2014.read(path)
    index = [torch.arange(i, 221, 8) for i in range(8)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(btf.texels, index * 3))
    assert all(torch.equal(f, whole[i]) for f, i in zip(found, index * 3, strict=True))


def test_factors_are_read_late(make: Make) -> None:
    path = make()
    first, second = ubo2014.read(path), ubo2014.read(path).load()
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    for btf in (first, second):
        with pytest.raises(DataError, match="ends within its factors"):
            btf.texels()
    path.unlink()
    for btf in (first, second):
        with pytest.raises(DataError, match="cannot be read any more"):
            btf.texels()


@pytest.mark.gpu
def test_gpu(btf: BTF, whole: torch.Tensor) -> None:
    index = torch.arange(200, 20, -3)
    found = btf.texels(index, "cuda")
    assert found.device.type == "cuda"
    torch.testing.assert_close(found.cpu(), whole[index], rtol=1e-4, atol=1e-5)
    assert torch.equal(btf.texels(index[:7], "cuda"), found[:7])
