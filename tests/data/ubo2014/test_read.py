"""What is read from files made by hand, against a second loader and exact arithmetic."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import ubo2014
from spmm_torch.data.ubo2014.header import VARIANTS
from spmm_torch.data.ubo2014.layout import read_layout
from spmm_torch.errors import DataError
from tests.data.ubo2014.independent_reader import load
from tests.data.ubo2014.planted import HEIGHT, LIGHT, VIEW, WIDTH, planted
from tests.planted.btfs import texel_major

Make = Callable[..., Path]


@pytest.mark.parametrize("rotated", [False, True])
@pytest.mark.parametrize("scalar", [2, 4, 8])
@pytest.mark.parametrize("variant", VARIANTS)
def test_planted_values_bit_for_bit(make: Make, variant: str, scalar: int, rotated: bool) -> None:
    rotations = np.arange(18.0).reshape(2, 3, 3) if rotated else None
    path = make(variant, scalar=scalar, rotations=rotations)
    btf = ubo2014.read(path)
    expected = load(path.read_bytes()).values()
    assert (expected < 0).any() and (expected > 1).any()
    assert torch.equal(btf.texels(), texel_major(np.maximum(expected, 0.0)))
    assert (btf.name, btf.path) == ("planted", str(path))
    assert (btf.height, btf.width, btf.pair_count, btf.channels) == (HEIGHT, WIDTH, 6, 3)
    assert btf.bytes_per_value == min(scalar, 4)
    np.testing.assert_array_equal(btf.picture(1, 2).numpy(), np.maximum(expected[1, 2], 0.0))
    np.testing.assert_array_equal(btf.pictures(1).numpy(), np.maximum(expected[1], 0.0))
    found = ubo2014.read_header(path).rotations
    np.testing.assert_array_equal(found, rotations if rotated else np.zeros((0, 3, 3)))


def test_header(make: Make) -> None:
    header = ubo2014.read_header(make(xml=b"<a>\xc3\xa4</a>"))
    assert (header.setup, header.sensor, header.light_source) == ("a dome", "a camera", "a lamp")
    assert (header.pixels_per_mm, header.rgb_scale) == (7.5, (1.0, 2.0, 3.0))
    assert (header.version, header.cosine, header.xml) == (4, True, "<a>ä</a>")
    assert header.channel_names == ("R", "G", "B")
    assert header.height_map is None
    np.testing.assert_array_equal(header.view, VIEW)
    np.testing.assert_array_equal(header.light, LIGHT)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("rotated", [False, True])
def test_header_versions(make: Make, version: int, rotated: bool) -> None:
    path = make(version=version, rotations=np.zeros((0, 3, 3)) if rotated else None)
    header = ubo2014.read_header(path)
    assert header.version == version
    assert header.cosine is (True if version > 1 else None)
    assert header.xml == ("<btf/>" if version > 2 else "")
    assert header.channel_names == ("R", "G", "B")


def test_a_header_size_that_looks_like_the_letter(make: Make) -> None:
    path = make(xml=b"x" * 47)
    assert path.read_bytes()[9:10] == b"R"
    assert ubo2014.read_header(path).xml == "x" * 47


def test_directions(make: Make) -> None:
    btf = ubo2014.read(make())
    expected = [[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)] for t, p in LIGHT]
    torch.testing.assert_close(btf.light, torch.tensor(expected).float(), rtol=0, atol=1e-6)
    torch.testing.assert_close(btf.view[0], torch.tensor([0.0, 0.0, 1.0]))


def test_colour_model_11(make: Make) -> None:
    changes = planted("DFMF08FC", low=-2, high=2)
    path = make(colour_model=11, left=changes["left"], right=changes["right"])
    expected = load(path.read_bytes()).values()
    assert expected.max() > 100.0  # nothing is cut at one
    torch.testing.assert_close(ubo2014.read(path).texels(), texel_major(np.maximum(expected, 0.0)))


def test_log_values(make: Make) -> None:
    changes = planted("FMF12FCE", low=-2, high=2)
    path = make("FMF12FCE", reduced=1, left=changes["left"], right=changes["right"])
    expected = load(path.read_bytes()).values()
    assert expected.max() > 100.0
    torch.testing.assert_close(ubo2014.read(path).texels(), texel_major(np.maximum(expected, 0.0)))


@pytest.mark.parametrize("extension", [0, 1, 2])
def test_extension_versions(make: Make, extension: int) -> None:
    header = ubo2014.read_header(make("FMF12FCE", extension=extension, reduced=1))
    assert header.log_values == (extension >= 1)


def test_height_map(make: Make) -> None:
    codes = np.arange(6, dtype=np.uint16).reshape(2, 3) * 10_000
    header = ubo2014.read_header(make("FMF12FCE", height_map=codes))
    assert header.height_map.dtype == np.uint16
    np.testing.assert_array_equal(header.height_map, codes)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_cosine_is_multiplied_in_once(make: Make, variant: str) -> None:
    included = ubo2014.read(make(variant, cosine=1)).texels()
    unknown = ubo2014.read(make(variant, version=1)).texels()
    assert torch.equal(included, unknown)
    btf = ubo2014.read(make(variant, cosine=0))
    wi, _ = btf.pairs()
    torch.testing.assert_close(btf.texels(), included * wi[:, 2:])
    torch.testing.assert_close(btf.picture(1, 2), (included * wi[:, 2:])[:, 5].view(5, 4, 3))


@pytest.mark.parametrize("scalar", [2, 4])
def test_sixteen_bits_of_range_keep_their_maximum(make: Make, scalar: int) -> None:
    left = [np.ones((6, 1))] * 3
    right = [np.full((WIDTH * HEIGHT, 1), 65504.0)] * 3
    btf = ubo2014.read(make(left=left, right=right, scalar=scalar))
    assert btf.is_hdr
    assert float(btf.texels().max()) == 65504.0
    assert btf.peak() == 65504.0


def test_ldr(make: Make) -> None:
    left, right = [np.ones((6, 1))] * 3, [np.full((WIDTH * HEIGHT, 1), 0.5)] * 3
    btf = ubo2014.read(make(left=left, right=right))
    assert not btf.is_hdr
    assert btf.peak() == 1.0


def test_load_tells_its_progress(make: Make) -> None:
    told = []
    ubo2014.read(make()).load(lambda done, total: told.append((done, total)))
    assert told == [(2, 2)]


def test_all_black(make: Make) -> None:
    btf = ubo2014.read(make(left=[np.ones((6, 1))] * 3, right=[np.zeros((20, 1))] * 3))
    with pytest.raises(DataError, match=r"planted\.btf is all black"):
        btf.load()


@pytest.mark.parametrize("scalar", [2, 4, 8])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("side", ["left", "right"])
def test_factors_that_are_not_finite(make: Make, side: str, value: float, scalar: int) -> None:
    changes = planted("DFMF08FC")
    matrix = changes[side][1].astype(float)
    matrix[4, 1] = value
    path = make(scalar=scalar, **{side: [changes[side][0], matrix, changes[side][2]]})
    with pytest.raises(DataError, match=f"holds the factor {value} at byte") as caught:
        ubo2014.read(path).texels()
    offset = int(str(caught.value).partition("at byte ")[2].partition(";")[0])
    kind = {2: "<e", 4: "<f", 8: "<d"}[scalar]
    found = struct.unpack(kind, path.read_bytes()[offset : offset + scalar])[0]
    assert found == value or np.isnan([found, value]).all()


def test_products_that_are_not_finite(make: Make) -> None:
    changes = planted("DFMF08FC")
    left = [part.astype(float) for part in changes["left"]]
    left[0][5] = 0.0, 0.0, 1e30
    right = [part.astype(float) for part in changes["right"]]
    right[0][:, 2] = 0.0
    right[0][1, 2] = 1e30
    path = make(left=left, right=right)
    with pytest.raises(DataError, match=r"to inf at \[texel 1, pair 5, channel 0\]"):
        ubo2014.read(path).load()
    store = ubo2014.FactorStore(path, read_layout(path))
    assert store.pairs(4, 5).isfinite().all()  # the bad value lies next to it
    assert store.texels(torch.tensor([0, 2])).isfinite().all()
    with pytest.raises(DataError, match="within float32"):
        right[0][0, 0] = 1e39
        ubo2014.read(make(left=left, right=right, scalar=8)).load()


@pytest.mark.parametrize("variant", VARIANTS)
def test_accepts(make: Make, variant: str) -> None:
    assert ubo2014.accepts(make(variant))


@pytest.mark.parametrize("magic", ["!PVF06FC", "!PVF06FCR", "!BDIF06R2!"])
def test_known_but_not_supported(tmp_path: Path, magic: str) -> None:
    path = tmp_path / "other.btf"
    path.write_bytes(magic.encode() + bytes(1000))
    assert ubo2014.accepts(path)
    with pytest.raises(DataError, match="not supported") as caught:
        ubo2014.read(path)
    assert all(f"!{variant}" in str(caught.value) for variant in VARIANTS)


def test_does_not_accept(tmp_path: Path) -> None:
    assert not ubo2014.accepts(tmp_path)
    assert not ubo2014.accepts(tmp_path / "nothing")
    for number, content in enumerate((b"", b"!", b"!FMF07FC", b"PK\x03\x04")):
        path = tmp_path / f"{number}.btf"
        path.write_bytes(content)
        assert not ubo2014.accepts(path)
        with pytest.raises(DataError, match="not supported"):
            ubo2014.read(path)
    with pytest.raises(DataError, match="cannot be read"):
        ubo2014.read(tmp_path / "nothing")
