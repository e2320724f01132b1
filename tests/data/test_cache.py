"""The cache: reused by content, shared between processes, and cleared."""

from __future__ import annotations

import errno
import hashlib
import json
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import BTF, Selection, load_btf
from spmm_torch.data.cache import (
    CacheEntry,
    clear,
    default_folder,
    entries,
    entry_key,
    file_hash,
    source_content,
)
from spmm_torch.data.picture_form import PictureForm
from spmm_torch.errors import OutputError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.pictures import encode_png, random_codes, write_pictures

VIEWS = 5
KEY = entry_key(("a test",))
SHAPE, DTYPE = (7, 15, 3), np.dtype(np.uint8)
# Pairs of them have the same shape.
PARTS = [
    Selection(),
    Selection(crop=(1, 0, 1, 2)),
    Selection(crop=(0, 0, 1, 2)),
    Selection(directions="views=0,1"),
    Selection(directions="views=1,2"),
    Selection(directions="lights=0,1"),
    Selection(directions="lights=0,2"),
]

NewFormat = Callable[..., object]


def assert_same(a: BTF, b: BTF) -> None:
    assert torch.equal(a.texels(), b.texels())
    index = torch.tensor([3, 0, 3, 7])
    assert torch.equal(a.texels(index), b.texels(index))
    assert torch.equal(a.texels(index > 0), b.texels(index > 0))
    assert torch.equal(a.picture(1, 2), b.picture(1, 2))
    assert torch.equal(a.pictures(1), b.pictures(1))
    assert (a.is_hdr, a.peak()) == (b.is_hdr, b.peak())


@contextmanager
def no_decoding(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fails if a picture is decoded."""

    def fail(*_: object) -> None:
        raise AssertionError("a picture was decoded")

    with monkeypatch.context() as patch:
        patch.setattr(PictureForm, "decode", fail)
        yield


def test_picture_sets_from_the_cache(
    picture_set: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = load_btf(picture_set).load()
    for limit in (None, 1, memory.raw_bytes):  # one band, a band for each view, two
        assert_same(load_btf(picture_set).load(memory=limit, cache=folder / str(limit)), memory)
        with no_decoding(monkeypatch):
            assert_same(load_btf(picture_set).load(cache=folder / str(limit)), memory)


@pytest.mark.parametrize("dtype", ["<f2", "<f4", ">f4"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npz_from_the_cache(tmp_path: Path, folder: Path, dtype: str, order: str) -> None:
    directions = ring_directions().numpy()
    values = np.random.default_rng(0).gamma(1.0, 2.0, (4, 3, 5, 6, 3))
    arrays = {"view": directions[:4], "light": directions[5:8]}
    np.savez(tmp_path / "a.npz", values=np.asarray(values, dtype=dtype, order=order), **arrays)
    memory = load_btf(tmp_path / "a.npz").load()
    for limit in (None, 1, memory.raw_bytes):
        calls: list[tuple[int, int]] = []
        for progress in (None, lambda *call, calls=calls: calls.append(call)):
            btf = load_btf(tmp_path / "a.npz")
            btf.load(progress, memory=limit, cache=folder / str(limit))
            assert_same(btf, memory)
        assert calls == [(4, 4)]  # found, not decoded
    for selection in PARTS:
        part = load_btf(tmp_path / "a.npz", selection=selection).load(cache=folder)
        assert torch.equal(
            part.texels(), load_btf(tmp_path / "a.npz", selection=selection).texels()
        )


def test_content_counts_and_not_the_name(
    tmp_path: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    codes = random_codes("uint8", (3, 3, 2, 2))
    for path in (tmp_path / "a.zip", tmp_path / "folder"):
        write_pictures(path, codes, encode_png, ".png")
        expected = load_btf(path).load(cache=folder).texels()
        other = path.rename(path.with_name(f"other-{path.name}"))
        with no_decoding(monkeypatch):
            assert torch.equal(load_btf(other).load(cache=folder).texels(), expected)
    copy = shutil.copytree(tmp_path / "other-folder", tmp_path / "copy")
    with no_decoding(monkeypatch):  # codes do not depend on what gamma makes of them
        linear = load_btf(copy, gamma=1.0).load(cache=folder)
    assert torch.equal(linear.texels(), load_btf(copy, gamma=1.0).texels())


def test_other_content_and_other_parts_are_decoded(
    tmp_path: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    codes = random_codes("uint8", (3, 3, 2, 2))
    for path in (tmp_path / "a.zip", tmp_path / "a"):
        codes[2, 2, 1, 1, 2] ^= 1  # between the zip and the folder, and again below
        for _ in range(2):
            codes[0, 0, 0, 0, 0] ^= 1
            write_pictures(path, codes, encode_png, ".png")
            for selection in PARTS:
                expected = load_btf(path, selection=selection).texels()
                cached = load_btf(path, selection=selection).load(cache=folder)
                assert torch.equal(cached.texels(), expected)
                with no_decoding(monkeypatch):
                    again = load_btf(path, selection=selection).load(cache=folder)
                assert torch.equal(again.texels(), expected)
    # Twice nothing changed for the part without view 0.
    assert len(list(folder.glob("*.npy"))) == 4 * len(PARTS) - 2


def test_key_of_everything() -> None:
    parts = [("a", 1), ("a", "1"), ("a1",), ("a", 1, None), (("a", 1),)]
    assert len({entry_key(part) for part in parts}) == len(parts)
    assert entry_key(parts[0]) == entry_key(list(parts[0]))


def test_file_hash(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"more than one block of it")
    expected = hashlib.blake2b(b"more than one block of it", digest_size=20).hexdigest()
    assert file_hash(tmp_path / "a", block=7) == expected


def test_default_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert default_folder() == Path("/somewhere/spmm_torch")
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert default_folder() == Path.home() / ".cache" / "spmm_torch"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert default_folder() == Path.home() / ".cache" / "spmm_torch"


def test_two_at_once_decode_once(new_format: NewFormat, folder: Path) -> None:
    fakes = [new_format("rgbe") for _ in range(4)]
    start = threading.Barrier(len(fakes))
    stores: list[object] = []

    def load(fake: object) -> None:
        start.wait()
        stores.append(fake.open(cache=folder, memory=1))

    threads = [threading.Thread(target=load, args=(fake,)) for fake in fakes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum(len(fake.bands) for fake in fakes) == VIEWS
    expected = fakes[0].open().texels(None)
    assert len(stores) == 4
    assert all(torch.equal(store.texels(None), expected) for store in stores)


def test_clear(new_format: NewFormat, folder: Path, killed: type[BaseException]) -> None:
    assert clear(folder) == (0, 0)
    new_format(seed=1).open(cache=folder)
    with pytest.raises(killed):
        new_format(seed=2, dies_at=3).open(cache=folder, memory=1)
    (folder / f".{KEY}.json.7.tmp").write_bytes(b"killed while noting")
    foreign = [folder / "values.npy", folder / "notes.json", folder / f"{KEY}.txt"]
    for path in foreign:
        path.write_bytes(b"not ours")
    (folder / "inner.npy").mkdir()
    files = [path for path in folder.iterdir() if path.is_file() and path not in foreign]
    size = sum(path.stat().st_blocks * 512 for path in files)
    count, freed = clear(folder)
    # The note that was left alone gets a lock before it goes.
    assert (count, freed) == (len(files) + 1, size)
    assert sorted(folder.iterdir()) == sorted([*foreign, folder / "inner.npy"])
    assert new_format(seed=1).open(cache=folder).texels(None).shape == SHAPE
    assert clear(folder)[0] == 3


def test_clear_of_the_own_folder(new_format: NewFormat, folder: Path) -> None:
    new_format().open(memory=1)
    assert len(list(default_folder().glob("*.npy"))) == 1
    assert clear()[0] == 3
    assert not list(default_folder().iterdir())


def test_clear_leaves_what_is_being_made(folder: Path) -> None:
    with CacheEntry.open(folder, KEY, "here", SHAPE, DTYPE) as entry:
        entry.reserve()
        assert clear(folder) == (0, 0)
        entry.put(np.ones(SHAPE, DTYPE), 0, views_done=1, highest=1.0)
        entry.finish()
    assert clear(folder)[0] == 3


def test_clear_that_fails(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new_format().open(cache=folder)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(OutputError, match="cannot be cleared .*Permission denied"):
        clear(folder)


def test_a_lock_that_was_removed_is_taken_anew(folder: Path) -> None:
    """Else whoever waited for it and whoever came later would both write."""
    inside, leave = threading.Event(), threading.Event()

    def second() -> None:
        with CacheEntry.open(folder, KEY, "here", SHAPE, DTYPE):
            inside.set()
            leave.wait(60)

    waiting = threading.Thread(target=second)
    with CacheEntry.open(folder, KEY, "here", SHAPE, DTYPE):
        waiting.start()
        assert not inside.wait(0.2)
        (folder / f"{KEY}.lock").unlink()
    assert inside.wait(60)
    assert clear(folder) == (0, 0)  # it holds the lock that has the name
    assert (folder / f"{KEY}.lock").exists()
    leave.set()
    waiting.join()


def test_entries(new_format: NewFormat, folder: Path, killed: type[BaseException]) -> None:
    assert entries(folder) == []
    new_format(seed=1).open(cache=folder)
    with pytest.raises(killed):
        new_format(seed=2, dies_at=3).open(cache=folder, memory=1)
    with pytest.raises(killed):
        new_format(seed=3, dies_at=0).open(cache=folder, memory=1)
    np.save(folder / "values.npy", np.zeros(3))  # not ours
    rows = sorted((source, state) for _, source, state in entries(folder))
    assert rows == [
        ("not known", "unfinished"),
        ("the fake", "unfinished"),
        ("the fake", "whole"),
    ]
    assert all(size > 0 for size, _, _ in entries(folder))


def test_sidecar_tells_what_it_was_made_of(picture_set: Path, folder: Path) -> None:
    load_btf(picture_set).load(cache=folder)
    facts = json.loads(next(folder.glob("*.json")).read_text())
    assert (facts["source"], facts["views_done"]) == (str(picture_set), 4)


def test_content_behind_links_counts(tmp_path: Path) -> None:
    """Readers follow links, so what they lead to is part of the input."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "input").mkdir()
    (tmp_path / "input" / "part").symlink_to(tmp_path / "disk")
    (tmp_path / "disk" / "a.binary").write_bytes(b"before")
    before = source_content(tmp_path / "input")
    (tmp_path / "disk" / "a.binary").write_bytes(b"after")
    assert [name for name, _ in before] == ["part/a.binary"]
    assert source_content(tmp_path / "input") != before
