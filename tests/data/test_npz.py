"""The NPZ interchange format and BTFs from arrays in memory: same rules, same messages."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from spmm_torch.data import BTF, load_btf, sample_path, write_npz
from spmm_torch.data.crop import crop_ubo2003
from spmm_torch.errors import DataError, OutputError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import texel_major

VIEW = ring_directions()[[0, 3]].numpy()
LIGHT = ring_directions()[[1, 8, 40]].numpy()
SHAPE = (2, 3, 4, 5, 3)


def make_values(dtype: type = np.float32, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    return np.random.default_rng(0).random(shape).astype(dtype)


def save(path: Path, **changes: object) -> Path:
    arrays = {"values": make_values(), "view": VIEW, "light": LIGHT} | changes
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    return path


@pytest.mark.parametrize("dtype", [np.float16, np.float32, ">f4", ">f2"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("savez", [np.savez, np.savez_compressed])
def test_read(tmp_path: Path, dtype: str, order: str, savez: object) -> None:
    values = np.asarray(make_values(), dtype=dtype, order=order)
    savez(tmp_path / "a.npz", values=values, view=VIEW, light=LIGHT)
    btf = load_btf(tmp_path / "a.npz")
    assert (btf.name, btf.height, btf.width, btf.pair_count) == ("a", 4, 5, 6)
    assert btf.bytes_per_value == values.itemsize
    assert torch.equal(btf.texels(), texel_major(values.astype("f4")))
    assert torch.equal(btf.view, torch.from_numpy(VIEW))
    np.testing.assert_array_equal(btf.picture(1, 2).numpy(), values[1, 2].astype("f4"))


def test_memory_stays_float16() -> None:
    btf = BTF.from_values(make_values(np.float16), VIEW, LIGHT)
    assert btf.load()._store.codes.rows(None).dtype == torch.float16
    assert btf.texels().dtype == torch.float32


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(*(st.integers(1, 4) for _ in range(4))),
    st.sampled_from([np.float16, np.float32]),
    st.integers(0, 2**31),
)
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory, shape: tuple, dtype: type, seed: int
) -> None:
    values = np.random.default_rng(seed).gamma(1.0, 2.0, (*shape, 3)).astype(dtype)
    directions = ring_directions()
    source = BTF.from_values(values, directions[: shape[0]], directions[-shape[1] :], name="x")
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    write_npz(path, source)
    btf = load_btf(path)
    assert torch.equal(btf.texels(), source.texels())
    assert torch.equal(btf.view, source.view)
    assert torch.equal(btf.light, source.light)
    assert btf.bytes_per_value == source.bytes_per_value == values.itemsize
    assert (btf.is_hdr, btf.peak()) == (source.is_hdr, source.peak())
    with np.load(path) as arrays:
        np.testing.assert_array_equal(arrays["values"], values)


def test_ubo2003_to_npz(tmp_path: Path) -> None:
    crop_ubo2003(sample_path(), 8, 16, 8, 8, tmp_path / "a.zip")
    source = load_btf(tmp_path / "a.zip")
    write_npz(tmp_path / "a.npz", source)
    assert torch.equal(load_btf(tmp_path / "a.npz").texels(), source.texels())


def test_from_tensor_equals_from_array() -> None:
    values = make_values()
    a = BTF.from_values(values, VIEW, LIGHT, name="a")
    b = BTF.from_values(torch.from_numpy(values), torch.tensor(VIEW), torch.tensor(LIGHT))
    assert (a.name, a.path) == ("a", "")
    assert torch.equal(a.texels(), b.texels())
    assert torch.equal(a.texels(), texel_major(values))


def test_hdr_rule_and_peak() -> None:
    values = make_values()
    assert not BTF.from_values(values, VIEW, LIGHT).is_hdr
    assert BTF.from_values(values, VIEW, LIGHT).peak() == 1.0
    btf = BTF.from_values(values * 4, VIEW, LIGHT)
    assert btf.is_hdr
    assert btf.peak() == pytest.approx(np.percentile(values * 4, 99.9, method="inverted_cdf"))


def test_values_are_read_late(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz", values=make_values() * np.float32(np.nan))
    btf = load_btf(path)
    with pytest.raises(DataError, match="nan at"):
        btf.texels()
    path.unlink()
    with pytest.raises(DataError, match="cannot be read"):
        btf.load()


def with_value(value: float) -> np.ndarray:
    values = make_values()
    values[1, 2, 3, 4, 0] = value
    return values


BAD_VALUES = {
    "nan": (with_value(np.nan), r"nan at \[view 1, light 2, row 3, column 4, channel 0\]"),
    "infinity": (with_value(np.inf), r"inf at \[view 1, light 2"),
    "half infinity": (with_value(np.inf).astype(np.float16), r"inf at \[view 1, light 2"),
    "negative": (
        with_value(-0.25),
        r"-0.25 at \[view 1, light 2.*data.negative as clip .*load_btf",
    ),
    "black": (np.zeros(SHAPE, np.float32), "all black"),
    "axes": (make_values()[0], r"shape \[3, 4, 5, 3\]; expected \[V, L, H, W, 3\]"),
    "channels": (make_values(shape=(2, 3, 4, 5, 4)), "expected \\[V, L, H, W, 3\\]"),
    "empty": (make_values(shape=(2, 3, 0, 5, 3)), "without an empty axis"),
    "double": (make_values(np.float64), "type float64; expected float16 or float32"),
    "integer": (np.ones(SHAPE, np.int32), "type int32"),
}
BAD_DIRECTIONS = {
    "count": (VIEW[:1], "holds 1 directions .* expected 2"),
    "shape": (VIEW[:, :2], r"shape \[2, 2\]; expected \[N, 3\]"),
    "not unit": (VIEW * 1.01, "not unit: number 0"),
    "zero": (VIEW * 0, "no direction: number 0 .*; mend it"),
    "nan": (VIEW * np.float32(np.nan), "no direction: number 0 .*; mend it"),
    "horizon": (VIEW * np.array([[1], [-1]]), r"under the horizon: number 1 \(from 0\)"),
    "doubled": (VIEW[[1, 1]], r"same direction twice, as numbers 0 and 1 \(from 0\)"),
}


@pytest.mark.parametrize("case", BAD_VALUES)
def test_bad_values(tmp_path: Path, case: str) -> None:
    values, message = BAD_VALUES[case]
    with pytest.raises(DataError, match=message):
        load_btf(save(tmp_path / "a.npz", values=values)).load()
    with pytest.raises(DataError, match=message):
        BTF.from_values(values, VIEW, LIGHT)


@pytest.mark.parametrize("case", BAD_DIRECTIONS)
def test_bad_directions_are_found_without_the_values(tmp_path: Path, case: str) -> None:
    view, message = BAD_DIRECTIONS[case]
    with pytest.raises(DataError, match=message):
        load_btf(save(tmp_path / "a.npz", view=view))
    with pytest.raises(DataError, match=message):
        BTF.from_values(make_values(), view, LIGHT)


def test_half_precision_directions_are_unit_enough() -> None:
    btf = BTF.from_values(make_values(), VIEW.astype(np.float16), LIGHT.astype(np.float16))
    torch.testing.assert_close(btf.light.norm(dim=-1), torch.ones(3))
    grazing = np.array([[1, 0, 0], [0, 1, -4e-8]], np.float32)
    assert BTF.from_values(make_values(), grazing, LIGHT).view[:, 2].min() == 0.0


@pytest.mark.parametrize("key", ["values", "view", "light"])
def test_missing_array(tmp_path: Path, key: str) -> None:
    with pytest.raises(DataError, match=f"lacks the array '{key}'"):
        load_btf(save(tmp_path / "a.npz", **{key: None}))


def test_pickles_stay_closed(tmp_path: Path) -> None:
    for key in ("values", "view"):
        path = save(tmp_path / "a.npz", **{key: np.array([{"a": 1}], dtype=object)})
        with pytest.raises(DataError):
            load_btf(path)


def test_truncated_array(tmp_path: Path) -> None:
    whole = save(tmp_path / "a.npz")
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(tmp_path / "b.npz", "w") as target:
        for name in source.namelist():
            content = source.read(name)
            target.writestr(name, content[:-8] if name == "values.npy" else content)
    with pytest.raises(DataError, match="ends early"):
        load_btf(tmp_path / "b.npz").load()


def test_no_room_for_values_that_are_not_there(tmp_path: Path) -> None:
    header = io.BytesIO()
    shape = (2, 3, 1 << 20, 1 << 20, 3)
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": shape}
    )
    whole = save(tmp_path / "a.npz")
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(tmp_path / "b.npz", "w") as target:
        for name in ("view.npy", "light.npy"):
            target.writestr(name, source.read(name))
        target.writestr("values.npy", header.getvalue() + bytes(100))
    with pytest.raises(DataError, match="ends early"):
        load_btf(tmp_path / "b.npz")  # before anyone looks for the memory


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_zip_that_lies_about_its_sizes_is_refused_at_once(tmp_path: Path, method: int) -> None:
    """Directory and header agree on a size that the stored bytes cannot have."""
    path = save(tmp_path / "a.npz", values=None)
    shape = (2, 3, 2**9, 2**9, 3)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": shape}
    )
    content = header.getvalue() + bytes(64)
    with zipfile.ZipFile(path, "a", method) as file:
        file.writestr("values.npy", content)
    claimed = len(header.getvalue()) + 4 * math.prod(shape)
    entry = b"PK\x01\x02"  # of the central directory; the member's own is the last one
    raw = bytearray(path.read_bytes())
    size_field = raw.rindex(entry) + 24
    assert int.from_bytes(raw[size_field : size_field + 4], "little") == len(content)
    raw[size_field : size_field + 4] = claimed.to_bytes(4, "little")
    path.write_bytes(raw)
    with pytest.raises(DataError, match=f"{claimed} bytes cannot come from"):
        load_btf(path)


def test_read_only_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", make_values())
    btf = BTF.from_values(np.load(tmp_path / "a.npy", mmap_mode="r"), VIEW, LIGHT)
    assert torch.equal(btf.texels(), texel_major(make_values()))
    swapped = BTF.from_values(make_values().astype(">f4"), VIEW, LIGHT)
    assert torch.equal(swapped.texels(), btf.texels())


def test_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    btf = BTF.from_values(make_values(), VIEW, LIGHT)
    with pytest.raises(OutputError, match="cannot be written"):
        write_npz(tmp_path / "no" / "a.npz", btf)

    def fail(view: int) -> None:
        raise OSError("disk full")

    (tmp_path / "a.npz").write_bytes(b"old")
    monkeypatch.setattr(btf, "pictures", fail)
    with pytest.raises(OutputError, match="disk full"):
        write_npz(tmp_path / "a.npz", btf)
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]
    assert (tmp_path / "a.npz").read_bytes() == b"old"


def test_bfloat16_is_refused() -> None:
    with pytest.raises(DataError, match="type bfloat16.*expected float16 or float32"):
        BTF.from_values(torch.ones(SHAPE, dtype=torch.bfloat16), VIEW, LIGHT)


def test_names_of_materials_are_kept(tmp_path: Path) -> None:
    names = np.array([f"material {index}" for index in range(20)])
    btf = load_btf(save(tmp_path / "a.npz", names=names))
    assert btf.names == tuple(names)
    write_npz(tmp_path / "b.npz", btf.restricted(torch.tensor([3, 17]), (1, 2)))
    assert load_btf(tmp_path / "b.npz").names == ("material 3", "material 17")
    assert load_btf(save(tmp_path / "c.npz")).names is None


@pytest.mark.parametrize("names", [np.array(["one"]), np.arange(20)])
def test_names_that_do_not_fit_are_refused(tmp_path: Path, names: np.ndarray) -> None:
    with pytest.raises(DataError, match=r"'names' of .* expected \[20\] texts"):
        load_btf(save(tmp_path / "a.npz", names=names))


def test_what_numpy_advises_is_not_handed_on(tmp_path: Path) -> None:
    """A header beyond its limit: three lines, and the advice to unpickle."""
    np.savez(tmp_path / "a.npz", values=make_values(), view=VIEW, light=LIGHT)
    with (
        zipfile.ZipFile(tmp_path / "a.npz") as source,
        zipfile.ZipFile(tmp_path / "b.npz", "w") as target,
    ):
        for name in source.namelist():
            content = source.read(name)
            end = 10 + int.from_bytes(content[8:10], "little")
            header = content[10:end].rstrip() + b" " * 20_000 + b"\n"
            start = b"\x93NUMPY\x02\x00" + len(header).to_bytes(4, "little")
            target.writestr(name, start + header + content[end:])
    with pytest.raises(DataError) as caught:
        load_btf(tmp_path / "b.npz")
    assert "\n" not in str(caught.value)
    assert "allow_pickle" not in str(caught.value)
