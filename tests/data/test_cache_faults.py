"""The cache after kills, full disks and damage: it goes on, says what is wrong, or begins anew."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from spmm_torch.data import cache, load_btf
from spmm_torch.errors import DataError, OutputError
from tests.planted.pictures import encode_png, random_codes, write_pictures

VIEWS = 5

NewFormat = Callable[..., object]


def names(folder: Path) -> list[str]:
    """What lies in a folder, without keys and locks."""
    found = sorted(path.name.partition(".")[2] for path in folder.iterdir())
    return [name for name in found if name != "lock"]


@contextmanager
def disk_of(capacity: int, monkeypatch: pytest.MonkeyPatch, folder: Path) -> Iterator[None]:
    """A disk of so many bytes that holds one folder."""

    def usage(_: Path) -> SimpleNamespace:
        used = sum(path.stat().st_size for path in folder.iterdir())
        return SimpleNamespace(free=capacity - used)

    with monkeypatch.context() as patch:
        patch.setattr(cache.shutil, "disk_usage", usage)
        yield


def no_space(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("dies_at", range(VIEWS))
@pytest.mark.parametrize("size", [1, 2, VIEWS])
def test_goes_on_at_the_band_where_it_was(
    new_format: NewFormat, kind: str, folder: Path, killed: type, dies_at: int, size: int
) -> None:
    fake = new_format(kind, dies_at=dies_at)
    loading = {"cache": folder, "memory": fake.memory_of(size)}
    with pytest.raises(killed):
        fake.open(**loading)
    assert not list(folder.glob("*.npy"))  # what is not whole has another name
    again, calls = new_format(kind), []
    store = again.open(progress=lambda *call: calls.append(call), **loading)
    first = dies_at - dies_at % size
    assert again.bands[0][0] == first
    assert calls == [(view + 1, VIEWS) for view in range(first, VIEWS)]
    expected = new_format(kind).open()
    assert torch.equal(store.texels(None), expected.texels(None))
    assert store.is_hdr == expected.is_hdr
    assert names(folder) == ["json", "npy"]


@pytest.mark.parametrize(
    ("where", "first"),
    [("os.posix_fallocate", 0), ("json.dumps", 0), ("os.replace", 0), ("CacheEntry.finish", None)],
)
def test_killed_between_the_steps(
    new_format: NewFormat,
    folder: Path,
    killed: type[BaseException],
    monkeypatch: pytest.MonkeyPatch,
    where: str,
    first: int | None,
) -> None:
    def die(*_: object) -> None:
        raise killed

    fake, again = new_format(), new_format()
    with monkeypatch.context() as patch, pytest.raises(killed):
        patch.setattr(f"spmm_torch.data.cache.{where}", die)
        fake.open(cache=folder, memory=1)
    with disk_of(fake.codes.nbytes + 999, monkeypatch, folder):  # what is left makes room
        store = again.open(cache=folder, memory=1)
    assert again.bands == [[view] for view in range(VIEWS)] if first == 0 else not again.bands
    assert torch.equal(store.texels(None), fake.open().texels(None))
    assert names(folder) == ["json", "npy"]


def test_every_band_is_on_disk_before_it_is_noted(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    for name in ("fsync", "replace"):
        call = getattr(os, name)
        monkeypatch.setattr(
            cache.os, name, lambda *given, n=name, c=call: (order.append(n), c(*given))
        )
    new_format().open(cache=folder, memory=1)
    assert order == ["fsync", "replace"] * VIEWS + ["replace"]


CHILD = """
import sys, time
from pathlib import Path
from spmm_torch.data import load_btf

def progress(done, total):
    if done == int(sys.argv[3]):
        print("here", flush=True)
        time.sleep(600)

load_btf(sys.argv[1]).load(progress, memory=1, cache=Path(sys.argv[2]))
"""


def test_one_decodes_and_another_goes_on_when_it_is_killed(tmp_path: Path, folder: Path) -> None:
    path = write_pictures(
        tmp_path / "a.zip", random_codes("uint8", (5, 3, 4, 4)), encode_png, ".png"
    )
    command = [sys.executable, "-c", CHILD, str(path), str(folder), "4"]
    calls: list[tuple[int, int]] = []
    waiting = load_btf(path)
    reader = threading.Thread(
        target=lambda: waiting.load(lambda *call: calls.append(call), memory=1, cache=folder)
    )
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout.readline() == "here\n"
            reader.start()
            reader.join(0.3)
            assert reader.is_alive() and not calls  # it waits for the other one
        finally:
            child.kill()  # SIGKILL
    reader.join(60)
    assert calls == [(4, 5), (5, 5)]  # three views had been finished
    assert torch.equal(waiting.texels(), load_btf(path).texels())


def test_too_little_space(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = new_format()
    with (
        disk_of(fake.codes.nbytes - 1, monkeypatch, folder),
        pytest.raises(OutputError, match="has 0.0 GB of free space, but the fake needs") as error,
    ):
        fake.open(cache=folder)
    assert str(folder) in str(error.value) and "--cache" in str(error.value)
    assert not fake.bands and not names(folder)
    assert fake.open(cache=folder).texels(None).shape == (7, 15, 3)


@pytest.mark.parametrize("call", ["posix_fallocate", "fsync", "replace"])
def test_disk_that_fills_up(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    fake = new_format()
    with monkeypatch.context() as patch:
        patch.setattr(cache.os, call, no_space)
        with pytest.raises(OutputError, match="cannot be written .*No space left") as error:
            fake.open(cache=folder, memory=1)
    assert str(folder) in str(error.value) and "\n" not in str(error.value)
    assert bool(names(folder)) == (call != "posix_fallocate")  # work that was done stays
    store = fake.open(cache=folder, memory=1)
    assert torch.equal(store.texels(None), new_format().open().texels(None))
    assert names(folder) == ["json", "npy"]


def test_disk_that_fills_up_half_way(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake, real = new_format(), os.replace
    done: list[object] = []

    def replace(*given: object) -> None:
        if len(done) == 3:
            no_space()
        done.append(given)
        real(*given)

    with monkeypatch.context() as patch, pytest.raises(OutputError):
        patch.setattr(cache.os, "replace", replace)
        fake.open(cache=folder, memory=1)
    again = new_format()
    store = again.open(cache=folder, memory=1)
    assert again.bands == [[3], [4]]
    assert torch.equal(store.texels(None), new_format().open().texels(None))


def test_folder_that_cannot_be_written(new_format: NewFormat, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"in the way")
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    places = [tmp_path / "file", tmp_path / "file" / "cache"]
    for place in places + [closed] * (os.geteuid() != 0):  # nothing is closed to root
        with pytest.raises(OutputError, match="cannot be written") as error:
            new_format().open(cache=place)
        assert str(place) in str(error.value) and "choose another folder" in str(error.value)
    assert (tmp_path / "file").read_bytes() == b"in the way"


DAMAGES: dict[str, tuple[str, Callable[[bytes], bytes | None]]] = {
    "sidecar gone": (".json", lambda content: None),
    "sidecar empty": (".json", lambda content: b""),
    "sidecar cut short": (".json", lambda content: content[:-5]),
    "sidecar of noise": (".json", lambda content: bytes(range(128, 200))),
    "sidecar of another kind": (".json", lambda content: b"[]"),
    "sidecar of nothing": (".json", lambda content: b"null"),
    "sidecar with nulls": (".json", lambda content: b'{"views_done": null, "highest": null}'),
    "sidecar without facts": (".json", lambda content: b"{}"),
    "codes gone": (".npy", lambda content: None),
    "codes empty": (".npy", lambda content: b""),
    "codes cut short": (".npy", lambda content: content[:-1]),
    "codes cut in the header": (".npy", lambda content: content[:30]),
    "codes of noise": (".npy", lambda content: b"noise" * 100),
    "codes of another shape": (".npy", lambda content: content.replace(b"(7, 15, ", b"(7, 14, ")),
    "codes of another type": (".npy", lambda content: content.replace(b"|u1", b"|i1")),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_damaged_entries_are_made_anew(
    new_format: NewFormat, folder: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    suffix, damage = DAMAGES[case]
    fake = new_format()
    fake.open(cache=folder)
    (path,) = folder.glob(f"*{suffix}")
    content = damage(path.read_bytes())
    path.unlink() if content is None else path.write_bytes(content)
    again = new_format()
    with disk_of(fake.codes.nbytes + 999, monkeypatch, folder):  # the old one makes room
        store = again.open(cache=folder)
    assert again.bands == [list(range(VIEWS))]
    assert torch.equal(store.texels(None), fake.open().texels(None))
    assert names(folder) == ["json", "npy"]


def test_a_note_without_its_codes_is_not_believed(
    new_format: NewFormat, folder: Path, killed: type[BaseException]
) -> None:
    new_format().open(cache=folder)
    next(folder.glob("*.npy")).unlink()
    with pytest.raises(killed):
        new_format(dies_at=0).open(cache=folder, memory=1)  # room is made, nothing is in it
    again = new_format()
    store = again.open(cache=folder, memory=1)
    assert len(again.bands) == VIEWS
    assert torch.equal(store.texels(None), new_format().open().texels(None))


def test_a_part_cut_short_is_begun_anew(
    new_format: NewFormat, folder: Path, killed: type[BaseException]
) -> None:
    with pytest.raises(killed):
        new_format(dies_at=3).open(cache=folder, memory=1)
    (part,) = folder.glob("*.npy.part")
    os.truncate(part, part.stat().st_size - 1)
    again = new_format()
    store = again.open(cache=folder, memory=1)
    assert len(again.bands) == VIEWS
    assert torch.equal(store.texels(None), new_format().open().texels(None))


def test_input_that_vanishes(picture_set: Path, folder: Path) -> None:
    btf = load_btf(picture_set)
    if picture_set.is_dir():
        next(path for path in picture_set.rglob("*") if path.is_file()).unlink()
    else:
        picture_set.unlink()
    with pytest.raises(DataError, match="cannot be") as error:
        btf.load(cache=folder)
    assert str(picture_set) in str(error.value)


def test_input_that_is_replaced(tmp_path: Path, folder: Path) -> None:
    write_pictures(tmp_path / "a.zip", random_codes("uint8", (2, 3, 2, 2)), encode_png, ".png")
    cached, direct = load_btf(tmp_path / "a.zip"), load_btf(tmp_path / "a.zip")
    write_pictures(tmp_path / "a.zip", random_codes("uint8", (2, 2, 2, 2)), encode_png, ".png")
    for load in (direct.load, lambda: cached.load(cache=folder)):
        with pytest.raises(DataError, match="tl030 pl090") as error:
            load()
        assert str(tmp_path / "a.zip") in str(error.value)
