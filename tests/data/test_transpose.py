"""From pictures to texels: the same values in memory and in the cache, however it is cut."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.data.cache import default_folder
from spmm_torch.data.codes import FileCodes, ViewCodes
from spmm_torch.data.store import CodeStore, float_chunks
from spmm_torch.data.transpose import DEFAULT_BAND_BYTES, transpose_into
from spmm_torch.errors import DataError

VIEWS, LIGHTS, TEXELS = 5, 3, 7
INDICES = [
    None,
    slice(2, 5),
    torch.tensor([6, 0, 3, 3]),
    torch.arange(TEXELS) % 2 == 1,
    torch.empty(0, dtype=torch.long),
]

NewFormat = Callable[..., object]


def assert_same(store: CodeStore, expected: CodeStore) -> None:
    for index in INDICES:
        assert torch.equal(store.texels(index), expected.texels(index))
    for start, stop in ((0, VIEWS * LIGHTS), (4, 5), (2, 11), (3, 3)):
        assert torch.equal(store.pairs(start, stop), expected.pairs(start, stop))
    assert store.is_hdr == expected.is_hdr


@given(st.data())
def test_transpose(data: st.DataObject) -> None:
    lights, texels, width = (data.draw(st.integers(1, 9)) for _ in range(3))
    dtype = data.draw(st.sampled_from([np.uint8, np.float16, np.float32]))
    before, after = data.draw(st.integers(0, 3)), data.draw(st.integers(0, 3))
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    pictures = rng.integers(0, 256, (lights, texels, width)).astype(dtype)
    band = np.zeros((texels, before + lights + after, width), dtype)
    transpose_into(band[:, before : before + lights], pictures)
    np.testing.assert_array_equal(band[:, before : before + lights], pictures.transpose(1, 0, 2))
    assert not band[:, :before].any() and not band[:, before + lights :].any()


def test_values_in_memory(new_format: NewFormat, kind: str) -> None:
    fake = new_format(kind)
    store = fake.open()
    assert isinstance(store.codes, ViewCodes)
    expected = fake.expand(torch.from_numpy(fake.texel_major.copy()))
    assert torch.equal(store.texels(None), expected)
    assert torch.equal(store.pairs(4, 9), expected[:, 4:9])
    assert store.is_hdr == bool((expected > 1.0).any()) == (kind not in ("uint8", "uint16"))


@pytest.mark.parametrize("views", [None, 0, 1, 2, 3, VIEWS])
def test_cache_gives_the_same_bits_whatever_the_bands(
    new_format: NewFormat, kind: str, tmp_path: Path, views: int | None
) -> None:
    fake = new_format(kind)
    memory = None if views is None else fake.memory_of(views)
    store = fake.open(cache=tmp_path / "cache", memory=memory)
    assert isinstance(store.codes, FileCodes)
    size = min(views or 1, VIEWS) if views is not None else VIEWS
    assert fake.bands == [list(range(VIEWS))[i : i + size] for i in range(0, VIEWS, size)]
    again = new_format(kind)
    assert_same(store, again.open())
    assert_same(again.open(cache=tmp_path / "cache"), store)
    assert len(again.bands) == 1  # once for memory, never for the cache


def test_blocks_of_an_entry(
    new_format: NewFormat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spmm_torch.data.cache.WRITTEN_TEXELS", 3)
    store = new_format("rgbe").open(cache=tmp_path, memory=1)
    assert_same(store, new_format("rgbe").open())
    for chunk in (1, 4, 99):
        blocks = list(float_chunks(store, TEXELS, chunk))
        assert [len(block) for block in blocks[:-1]] == [chunk] * (len(blocks) - 1)
        assert torch.equal(torch.cat(blocks), store.texels(None))


@pytest.mark.usefixtures("folder")
def test_cache_only_for_what_exceeds_the_memory(new_format: NewFormat) -> None:
    fake = new_format()
    size = fake.codes.nbytes
    for memory in (None, size):
        assert isinstance(fake.open(memory=memory).codes, ViewCodes)
    assert not default_folder().exists()
    assert isinstance(fake.open(memory=size - 1).codes, FileCodes)
    assert len(list(default_folder().glob("*.npy"))) == 1


def test_bands_stay_below_the_memory(new_format: NewFormat, tmp_path: Path) -> None:
    """Half of what is allowed is left to decoding, and one view is the least."""
    fake = new_format()
    view = fake.codes[0].nbytes
    for number, (memory, views) in enumerate([(4 * view, 2), (4 * view - 1, 1), (1, 1)]):
        fake.bands.clear()
        fake.open(cache=tmp_path / str(number), memory=memory)
        assert max(map(len, fake.bands)) == views
    assert VIEWS * view < DEFAULT_BAND_BYTES


def test_progress_goes_on_over_bands(new_format: NewFormat, tmp_path: Path) -> None:
    fake, calls = new_format(), []
    loading = {"cache": tmp_path, "memory": fake.memory_of(2)}
    fake.open(progress=lambda *call: calls.append(call), **loading)
    assert calls == [(view + 1, VIEWS) for view in range(VIEWS)]
    fake.open(progress=lambda *call: calls.append(call), **loading)
    assert calls[VIEWS:] == [(VIEWS, VIEWS)]


def test_errors_of_others_are_not_the_caches(new_format: NewFormat, tmp_path: Path) -> None:
    def refuse(*_: int) -> None:
        raise BrokenPipeError("nobody listens")

    with pytest.raises(BrokenPipeError):
        new_format().open(progress=refuse, cache=tmp_path)


@pytest.mark.parametrize(
    ("value", "columns", "message"),
    [
        (np.nan, 0, r"the fake holds nan at \[view 3, light 1, texel 5, channel 2\]"),
        (np.inf, 0, r"inf at \[view 3, light 1, texel 5, channel 2\]"),
        (-0.5, 4, r"-0.5 at \[view 3, light 1, row 1, column 1, channel 2\]"),
    ],
)
@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_bad_values_are_placed(
    new_format: NewFormat, tmp_path: Path, kind: str, value: float, columns: int, message: str
) -> None:
    fake = new_format(kind, columns=columns)
    fake.codes[3, 1, 5, 2] = value
    for loading in ({}, {"cache": tmp_path, "memory": fake.memory_of(2)}):
        for _ in range(2):  # nothing of it is taken for good the second time
            with pytest.raises(DataError, match=message):
                fake.open(**loading)
    assert not list(tmp_path.glob("*.npy"))


def test_all_black(new_format: NewFormat, kind: str, tmp_path: Path) -> None:
    fake = new_format(kind)
    fake.codes[:] = 0
    for loading in ({}, {"cache": tmp_path}, {"cache": tmp_path}):
        with pytest.raises(DataError, match="the fake is all black"):
            fake.open(**loading)


@pytest.mark.parametrize("where", [(0, 0, 0, 0), (4, 2, 6, 2)])
def test_hdr_is_told_by_the_highest_of_all_bands(
    new_format: NewFormat, tmp_path: Path, where: tuple[int, ...]
) -> None:
    fake = new_format("float32")
    fake.codes[:] = 1.0
    assert not fake.open().is_hdr
    fake.codes[where] = np.nextafter(np.float32(1), np.float32(2))
    for _ in range(2):
        assert fake.open(cache=tmp_path, memory=1).is_hdr
