"""The cache: decoded BTFs on disk, texel-major, under the hash of what they were decoded from.

An entry is `KEY.npy`, `[T, D, B]` in the source's own bits, with `KEY.json` beside it. While it is
made it is called `KEY.npy.part`; `KEY.json` then tells how many views are done, so that work goes
on there after a kill. Processes that want the same entry wait for the one that makes it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout
from platformdirs import user_cache_path

from ..errors import OutputError
from ..runtime.atomic import write_atomic
from ..runtime.memory import slices

# Part of every key: entries of another layout are never found.
LAYOUT_VERSION = 1
# Texels that are written at once: a few hundred MB of mapped pages at most.
WRITTEN_TEXELS = 1 << 12
# Of the files of an entry; whoever holds the last one may touch the others.
SUFFIXES = (".npy", ".npy.part", ".json", ".lock")
KEY_BYTES = 20
ENTRY_FILE = re.compile(rf"([0-9a-f]{{{2 * KEY_BYTES}}})({'|'.join(map(re.escape, SUFFIXES))})")
# A file of an entry under the name that it has until it is whole: left behind by a kill only.
UNFINISHED_FILE = re.compile(rf"\.{ENTRY_FILE.pattern}\.\d+\.tmp")
HASH_BLOCK = 1 << 22
# What `st_blocks` counts.
BLOCK_BYTES = 512


def default_folder() -> Path:
    """The user's own cache folder for this program."""
    return user_cache_path("spmm_torch")


def entry_key(parts: Iterable[object]) -> str:
    """The hash of everything that the codes of an entry depend on."""
    digest = hashlib.blake2b(digest_size=KEY_BYTES)
    for part in (LAYOUT_VERSION, *parts):
        digest.update(repr(part).encode() + b"\0")
    return digest.hexdigest()


def file_hash(path: Path, block: int = HASH_BLOCK) -> str:
    """The hash of a file's content, which is read in blocks of so many bytes.

    Raises:
        OSError: the file cannot be read.
    """
    digest = hashlib.blake2b(digest_size=KEY_BYTES)
    with path.open("rb") as file:
        while content := file.read(block):
            digest.update(content)
    return digest.hexdigest()


def entries(folder: Path | None = None) -> list[tuple[int, str, str]]:
    """(bytes on disk, what it was decoded from, "whole" or "unfinished") of every entry."""
    rows = []
    for path in sorted((folder or default_folder()).glob("*.npy*")):
        match = ENTRY_FILE.fullmatch(path.name)
        if match is None:
            continue
        try:
            facts = json.loads((path.parent / f"{match[1]}.json").read_text("utf-8"))
            source = str(facts["source"])
        except (OSError, ValueError, TypeError, KeyError):
            source = "not known"
        state = "unfinished" if path.suffix == ".part" else "whole"
        rows.append((path.stat().st_blocks * BLOCK_BYTES, source, state))
    return rows


def clear(folder: Path | None = None) -> tuple[int, int]:
    """Removes all entries but those that are being made; returns (number of files, bytes freed).

    Raises:
        OutputError: an entry cannot be removed.
    """
    folder = folder or default_folder()
    count = freed = 0
    try:
        for key in _keys(folder) if folder.is_dir() else ():
            with suppress(Timeout), FileLock(folder / f"{key}.lock", blocking=False):
                for path in (
                    *folder.glob(f".{key}.*.tmp"),
                    *(folder / f"{key}{s}" for s in SUFFIXES),
                ):
                    if path.exists():
                        freed += path.stat().st_blocks * BLOCK_BYTES  # of reserved ones, too
                        path.unlink()
                        count += 1
    except OSError as error:
        raise OutputError(
            f"the cache {folder} cannot be cleared ({error}); check its permissions."
        ) from error
    return count, freed


def _keys(folder: Path) -> list[str]:
    """The entries of a folder, which may hold other files as well."""
    names = [path.name for path in folder.iterdir()]
    found = [kind.fullmatch(name) for kind in (ENTRY_FILE, UNFINISHED_FILE) for name in names]
    return sorted({match[1] for match in found if match})


@dataclass
class CacheEntry:
    """One entry, held by this process alone; made by `CacheEntry.open`.

    Attributes:
        folder, key: where it lies.
        where: what it was decoded from, for messages.
        shape, dtype: of its codes, (T, D, B).
        views_done: how many views are in it.
        highest: the highest value so far.
        complete: whether it can be read.
    """

    folder: Path
    key: str
    where: str
    shape: tuple[int, ...]
    dtype: np.dtype
    views_done: int = field(default=0, init=False)
    highest: float = field(default=0.0, init=False)
    complete: bool = field(default=False, init=False)

    @classmethod
    @contextmanager
    def open(
        cls, folder: Path | None, key: str, where: str, shape: tuple[int, ...], dtype: np.dtype
    ) -> Iterator[CacheEntry]:
        """The entry of a key, as far as it was made; waits while another process makes it.

        Raises:
            OutputError: the cache cannot be written.
        """
        entry = cls(folder or default_folder(), key, where, shape, dtype)
        with ExitStack() as stack:
            with entry._output_errors():
                entry.folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(FileLock(entry.folder / f"{key}.lock"))
                entry._find()
            yield entry

    @contextmanager
    def _output_errors(self) -> Iterator[None]:
        """Around what touches the cache, and not around what a caller does meanwhile."""
        try:
            yield
        except OSError as error:
            raise OutputError(
                f"the cache {self.folder} cannot be written ({error}); expected a writable folder "
                f"with enough space; free some, or choose another folder with --cache."
            ) from error

    @property
    def path(self) -> Path:
        """The finished codes."""
        return self.folder / f"{self.key}.npy"

    @property
    def _part(self) -> Path:
        return self.folder / f"{self.key}.npy.part"

    @property
    def _facts(self) -> Path:
        return self.folder / f"{self.key}.json"

    def _find(self) -> None:
        """Looks what is there; what is damaged counts as not there."""
        complete = self._is_whole(self.path)
        if not (complete or self._is_whole(self._part)):
            return
        try:
            facts = json.loads(self._facts.read_text(encoding="utf-8"))
            self.views_done, self.highest = int(facts["views_done"]), float(facts["highest"])
        except (OSError, ValueError, TypeError, KeyError):  # killed before the first band was done
            return
        self.complete = complete

    def _is_whole(self, path: Path) -> bool:
        try:
            codes = np.lib.format.open_memmap(path, mode="r")
        except (OSError, ValueError, OverflowError):
            return False
        return (codes.shape, codes.dtype) == (self.shape, self.dtype)

    def reserve(self) -> None:
        """Makes room for all codes, so that a full disk shows before any work is done.

        Raises:
            OutputError: not enough space.
        """
        if self.views_done:
            return
        with self._output_errors():
            for path in (self._facts, self.path, self._part):  # what is damaged, or was just begun
                path.unlink(missing_ok=True)
            size = math.prod(self.shape) * self.dtype.itemsize
            free = shutil.disk_usage(self.folder).free
            if size > free:
                raise OutputError(
                    f"the cache {self.folder} has {free / 1e9:.1f} GB of free space, but "
                    f"{self.where} needs {size / 1e9:.1f} GB; free some, or choose another folder "
                    f"with --cache."
                )
            try:
                self._allocate()
            except OSError:
                self._part.unlink(missing_ok=True)
                raise

    def _allocate(self) -> None:
        np.lib.format.open_memmap(self._part, mode="w+", dtype=self.dtype, shape=self.shape)
        with self._part.open("r+b") as file:
            # A hole that the disk cannot fill would kill the process at the first write.
            os.posix_fallocate(file.fileno(), 0, os.fstat(file.fileno()).st_size)

    def put(self, codes: np.ndarray, first_pair: int, *, views_done: int, highest: float) -> None:
        """Writes a band of codes `[T, d, B]` and notes that it is there.

        Raises:
            OutputError: the disk is full.
        """
        pairs = slice(first_pair, first_pair + codes.shape[1])
        facts = {"source": self.where, "views_done": views_done, "highest": highest}
        with self._output_errors():
            for block in slices(len(codes), WRITTEN_TEXELS):
                # Mapped anew for every block, so that its pages do not stay in memory.
                np.lib.format.open_memmap(self._part, mode="r+")[block, pairs] = codes[block]
            with self._part.open("rb") as file:
                os.fsync(file.fileno())  # a power cut must not leave the note without the band
            write_atomic(self._facts, json.dumps(facts).encode())
        self.views_done, self.highest = views_done, highest

    def finish(self) -> None:
        """All views are there."""
        with self._output_errors():
            os.replace(self._part, self.path)
        self.complete = True
