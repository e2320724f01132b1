"""What is written, read by the second loader and by our own reader."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, ubo2014
from spmm_torch.data.ubo2014 import FactorRows, Header, write_factors, write_ubo2014
from spmm_torch.data.ubo2014.header import VARIANTS
from spmm_torch.errors import ConfigError, DataError, OutputError
from spmm_torch.geometry.directions import ring_directions
from tests.data.ubo2014.independent_reader import load
from tests.data.ubo2014.planted import HEIGHT, LIGHT, VIEW, WIDTH, planted, random_btf

BIG = {2: 60_000.0, 4: 3e38, 8: 1e300}
TINY = {2: 6e-8, 4: 1e-45, 8: 5e-324}


def make_header(variant: str, **changes: object) -> Header:
    return Header(variant, WIDTH, HEIGHT, VIEW, LIGHT, **changes)


def random_factors(variant: str, scalar: int) -> list[FactorRows]:
    """Factors that use the whole range of a type of number."""
    random = np.random.default_rng(3)
    kind = np.dtype(f"f{scalar}")
    shapes = planted(variant)
    factors = []
    for left, right in zip(shapes["left"], shapes["right"], strict=True):
        u, sv = random.normal(size=left.shape).astype(kind), random.normal(size=right.shape)
        u[0, 0], sv[0, 0], sv[-1, -1] = BIG[scalar], -BIG[scalar], TINY[scalar]
        factors.append(FactorRows(np.arange(left.shape[1], 0, -1.0), u, sv.astype(kind)))
    return factors


def in_file(right: np.ndarray, rows: str | None) -> np.ndarray:
    """Rows of SV as they lie in a file of an order of rows."""
    pictures = right.reshape(HEIGHT, WIDTH, -1)
    return (pictures[::-1] if rows == "bottom" else pictures).reshape(right.shape)


@pytest.mark.parametrize("rows", [None, "top", "bottom"])
@pytest.mark.parametrize("scalar", [2, 4, 8])
@pytest.mark.parametrize("variant", VARIANTS)
def test_factors_bit_for_bit(tmp_path: Path, variant: str, scalar: int, rows: str | None) -> None:
    factors = random_factors(variant, scalar)
    path = tmp_path / "a.btf"
    write_factors(path, make_header(variant, rows=rows), factors, scalar=scalar)
    found = load(path.read_bytes())
    assert found.variant == variant
    for given, s, u, sv in zip(
        factors, found.singular_values, found.left, found.right, strict=True
    ):
        np.testing.assert_array_equal(s, given.singular_values)
        assert u.tobytes() == given.left.tobytes()
        assert sv.tobytes() == in_file(given.right, rows).tobytes()


@pytest.mark.parametrize("variant", VARIANTS)
def test_our_reader_gives_what_the_second_one_gives(tmp_path: Path, variant: str) -> None:
    shapes = planted(variant)
    factors = [
        FactorRows(np.ones(u.shape[1]), u, sv)
        for u, sv in zip(shapes["left"], shapes["right"], strict=True)
    ]
    path = tmp_path / "a.btf"
    write_factors(path, make_header(variant), factors, scalar=2)
    values = np.maximum(load(path.read_bytes()).values(), 0.0)
    btf = ubo2014.read(path)
    for view in range(len(VIEW)):
        np.testing.assert_array_equal(btf.pictures(view).numpy(), values[view])
    if variant == "DFMF08FC":  # the texels are those that were given, top row first
        plane = np.maximum(shapes["right"][1] @ shapes["left"][1].T, 0)  # [T, D]
        np.testing.assert_array_equal(btf.texels()[..., 1].numpy(), plane)


@pytest.mark.parametrize("rows", ["top", "bottom"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_header_survives(tmp_path: Path, variant: str, rows: str) -> None:
    changes: dict[str, object] = {
        "cosine": False,
        "setup": "dome",
        "sensor": "a" * 80,
        "light_source": "lämp",
        "pixels_per_mm": 7.25,
        "rgb_scale": (1.0, 0.5, 2.0),
        "xml": "<measurement/>",
        "rows": rows,
        "rotations": np.arange(27, dtype=np.float32).reshape(3, 3, 3),
    }
    if variant == "DFMF08FC":
        changes |= {
            "colour_model": 11,
            "colour_mean": (1.0, 2.0, 3.0),
            "colour_transform": np.arange(9, dtype=np.float32).reshape(3, 3),
        }
    if variant == "FMF12FCE":
        codes = np.arange(30, dtype=np.uint16).reshape(5, 6) * 2000
        changes |= {"log_values": True, "height_map": codes}
    header = make_header(variant, **changes)
    write_factors(tmp_path / "a.btf", header, random_factors(variant, 4))
    found = ubo2014.read_header(tmp_path / "a.btf")
    assert vars(found).keys() == vars(header).keys()
    for key, value in vars(header).items():
        np.testing.assert_array_equal(getattr(found, key), value, err_msg=key)
    second = load((tmp_path / "a.btf").read_bytes())
    assert (second.version, second.cosine, second.names) == (4, 0, [b"R", b"G", b"B"])
    assert second.xml == f'<measurement/><?spmm rows="{rows}"?>'.encode()
    assert second.reduced == (variant == "FMF12FCE")
    if variant == "FMF12FCE":
        np.testing.assert_array_equal(second.height_map, codes[:: 1 if rows == "top" else -1])


@pytest.mark.parametrize("size", [1, 3, 7, 20])
def test_blocks_of_rows(tmp_path: Path, size: int) -> None:
    factors = random_factors("DFMF08FC", 4)
    write_factors(tmp_path / "a.btf", make_header("DFMF08FC"), factors)

    def blocks(matrix: np.ndarray) -> Iterator[torch.Tensor]:
        return (torch.from_numpy(matrix[i : i + size]) for i in range(0, len(matrix), size))

    streamed = [replace(f, left=blocks(f.left), right=blocks(f.right)) for f in factors]
    write_factors(tmp_path / "b.btf", make_header("DFMF08FC"), streamed)
    assert (tmp_path / "a.btf").read_bytes() == (tmp_path / "b.btf").read_bytes()


@pytest.mark.parametrize(("components", "height"), [(3, 4), (8, 4), (100, 4), (100, 1)])
@pytest.mark.parametrize("variant", VARIANTS)
def test_decomposition_is_the_best_one(
    tmp_path: Path, variant: str, components: int, height: int
) -> None:
    btf = random_btf(height)
    path = tmp_path / "a.btf"
    write_ubo2014(path, btf, components=components, variant=variant, scalar=8)
    found = load(path.read_bytes())
    cosine = btf.pairs()[0][:, 2:].double().numpy()  # [D, 1]
    values = btf.texels().double().numpy()  # [T, D, 3]
    matrices = (
        [values[..., channel] for channel in range(3)]
        if variant == "DFMF08FC"
        else [values.reshape(len(values), -1)]
    )
    for matrix, s, u, sv in zip(
        matrices, found.singular_values, found.left, found.right, strict=True
    ):
        left, sigma, right = np.linalg.svd(matrix, full_matrices=False)
        kept = min(components, *matrix.shape)
        assert len(s) == kept
        np.testing.assert_allclose(s, sigma[:kept], rtol=1e-9, atol=1e-9)
        best = (left[:, :kept] * sigma[:kept]) @ right[:kept]
        u = u * np.repeat(cosine, len(u) // len(cosine), axis=0)  # the file is without the cosine
        np.testing.assert_allclose(sv @ u.T, best, atol=1e-6)
        np.testing.assert_allclose(u.T @ u, np.eye(kept), atol=1e-6)


def test_decomposition_of_a_large_matrix_is_nearly_the_best_one(tmp_path: Path) -> None:
    """Slowly fading singular values, the hard case, and more of them than are looked at."""
    random = np.random.default_rng(0)
    directions = ring_directions()[:20]
    left = np.linalg.qr(random.normal(size=(900, 400)))[0]
    right = np.linalg.qr(random.normal(size=(400, 400)))[0]
    matrix = (left / np.sqrt(1.0 + np.arange(400.0))) @ right.T  # [T, D]
    values = matrix.T.reshape(20, 20, 30, 30, 1).repeat(3, axis=-1).astype(np.float32)
    offset = 1.0  # keeps values above zero and is one component
    btf = BTF.from_values(values + np.float32(offset), directions, directions)
    write_ubo2014(tmp_path / "a.btf", btf, components=41)
    error = (ubo2014.read(tmp_path / "a.btf").texels() - btf.texels()).double()
    sigma = np.linalg.svd(matrix + offset, compute_uv=False)
    best = float(np.sqrt(3.0 * (sigma[41:] ** 2).sum()))
    assert best * 0.99 < float(error.norm()) < best * 1.01


@pytest.mark.parametrize("scalar", [2, 4, 8])
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"colour_model": 11},
        {"variant": "FMF06FC"},
        {"variant": "FMF12FCE"},
        {"variant": "FMF12FCE", "log_values": True},
    ],
)
def test_full_rank_round_trip(tmp_path: Path, settings: dict, scalar: int) -> None:
    btf = random_btf()
    write_ubo2014(tmp_path / "a.btf", btf, scalar=scalar, **settings)
    found = ubo2014.read(tmp_path / "a.btf")
    tolerance = {2: 6e-3, 4: 1e-4, 8: 1e-4 if settings.get("colour_model") else 1e-6}[scalar]
    torch.testing.assert_close(found.texels(), btf.texels(), rtol=tolerance, atol=tolerance)
    torch.testing.assert_close(found.view, btf.view, rtol=0, atol=1e-6)
    torch.testing.assert_close(found.light, btf.light, rtol=0, atol=1e-6)
    assert ubo2014.read_header(tmp_path / "a.btf").cosine is False


def test_colour_model_11_of_black_and_saturated_colours(tmp_path: Path) -> None:
    colours = np.array(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (900, 0, 900), (1e-6, 0, 1e-7), (1, 1, 1)]
    )
    values = colours.astype(np.float32).reshape(1, 1, 1, -1, 3).repeat(2, axis=1)
    btf = BTF.from_values(values, ring_directions()[:1], ring_directions()[1:3])
    write_ubo2014(tmp_path / "a.btf", btf, colour_model=11, scalar=8)
    found = ubo2014.read(tmp_path / "a.btf")
    size = btf.texels().amax(dim=(1, 2), keepdim=True).clamp_min(1.0)  # of the channels that cancel
    torch.testing.assert_close(found.texels() / size, btf.texels() / size, rtol=1e-6, atol=1e-6)
    by_others = load((tmp_path / "a.btf").read_bytes()).values()
    cosine = btf.light[:, 2].double().numpy()[:, None, None, None]
    np.testing.assert_allclose(by_others * cosine, values, rtol=1e-6, atol=1e-6)


def test_seed_decides_the_bytes(tmp_path: Path) -> None:
    btf = random_btf(12, 12, 8, 8)
    contents = []
    for seed in (None, None, 1, 1):
        generator = None if seed is None else torch.Generator().manual_seed(seed)
        write_ubo2014(tmp_path / "a.btf", btf, components=2, generator=generator)
        contents.append((tmp_path / "a.btf").read_bytes())
    assert contents[0] == contents[1] != contents[2] == contents[3]


def test_progress(tmp_path: Path) -> None:
    told = []
    write_ubo2014(tmp_path / "a.btf", random_btf(), progress=lambda *call: told.append(call))
    assert told == [(30, 120), (60, 120), (90, 120), (120, 120)]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"components": 0}, "components is 0; expected 1"),
        ({"scalar": 3}, "scalar is 3; expected 2, 4 or 8"),
        ({"variant": "PVF06FC"}, "variant is 'PVF06FC'; expected one of DFMF08FC"),
        ({"colour_model": 3}, "colour_model is 3 .* expected 0 or 11"),
        ({"colour_model": 11, "variant": "FMF06FC"}, "colour_model is 11 .* expected 0"),
        ({"log_values": True}, "log_values was given for a DFMF08FC file; only FMF12FCE"),
    ],
)
def test_settings(tmp_path: Path, settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        write_ubo2014(tmp_path / "a.btf", random_btf(), **settings)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"right": np.ones((19, 3))}, r"SV does not have the shape of its file; .* \[20, 3\]"),
        ({"right": np.ones((21, 3))}, "SV does not have the shape"),
        ({"right": np.ones((20, 2))}, "SV does not have the shape"),
        ({"left": [np.ones((4, 3)), np.ones((1, 3))]}, r"U does not have .* expected \[6, 3\]"),
        ({"left": np.full((6, 3), 7e4)}, "U holds a number that 2 bytes cannot hold in its rows 0"),
        ({"right": np.full((20, 3), np.nan)}, "SV holds a number that 2 bytes cannot hold"),
        ({"singular_values": np.ones(0)}, "without a component"),
    ],
)
def test_factors_that_do_not_fit(tmp_path: Path, changes: dict, message: str) -> None:
    factors = random_factors("DFMF08FC", 2)
    factors[0] = replace(factors[0], **changes)
    (tmp_path / "a.btf").write_bytes(b"old")
    with pytest.raises(DataError, match=message):
        write_factors(tmp_path / "a.btf", make_header("DFMF08FC"), factors, scalar=2)
    with pytest.raises(DataError, match="2 pairs of factors were given .* expected 3"):
        write_factors(tmp_path / "a.btf", make_header("DFMF08FC"), factors[:2])
    assert [file.name for file in tmp_path.iterdir()] == ["a.btf"]
    assert (tmp_path / "a.btf").read_bytes() == b"old"


def test_text_that_does_not_fit(tmp_path: Path) -> None:
    header = make_header("DFMF08FC", sensor="ä" * 41)
    with pytest.raises(ConfigError, match="sensor has 82 bytes; expected 80"):
        write_factors(tmp_path / "a.btf", header, random_factors("DFMF08FC", 4))
    assert not list(tmp_path.iterdir())


def test_large_singular_values_do_not_stop_half_precision(tmp_path: Path) -> None:
    factors = [
        replace(f, singular_values=np.full(len(f.singular_values), 1e6))
        for f in random_factors("DFMF08FC", 2)
    ]
    write_factors(tmp_path / "a.btf", make_header("DFMF08FC"), factors, scalar=2)
    assert load((tmp_path / "a.btf").read_bytes()).singular_values[0].max() == 65504.0


def test_failed_write_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write_ubo2014(tmp_path / "no" / "a.btf", random_btf())

    def fail() -> Iterator[np.ndarray]:
        yield np.ones((5, 3))
        raise OSError("disk full")

    (tmp_path / "a.btf").write_bytes(b"old")
    factors = random_factors("DFMF08FC", 4)
    factors[2] = FactorRows(np.ones(3), np.ones((6, 3)), fail())
    with pytest.raises(OutputError, match="disk full"):
        write_factors(tmp_path / "a.btf", make_header("DFMF08FC"), factors)
    assert [file.name for file in tmp_path.iterdir()] == ["a.btf"]
    assert (tmp_path / "a.btf").read_bytes() == b"old"
