"""The cache: decoded BTFs on disk, texel-major, named by a hash of their source.

An entry is `KEY.npy`, codes `[T, D, B]` as in the source, with `KEY.json` beside it. An unfinished
entry is called `KEY.npy.part`, and `KEY.json` counts its views, from which a killed run resumes.
Processes that want the same entry wait for the one that makes it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from filelock import Timeout

from ..errors import DataError, OutputError
from ..runtime.atomic import write_atomic
from ..runtime.lock import locked
from ..runtime.memory import reserve, slices
from .folder_files import folder_files, is_hidden

# Part of every key, so that entries of another layout, or decoded by other rules, are never found.
LAYOUT_VERSION = 2
# Texels that are written at once: at most a few hundred MB of mapped pages.
WRITTEN_TEXELS = 1 << 12
# Suffixes of the files of an entry; the holder of the last one, the lock, may touch the others.
SUFFIXES = (".npy", ".npy.part", ".json", ".lock")
KEY_BYTES = 20
ENTRY_FILE = re.compile(rf"([0-9a-f]{{{2 * KEY_BYTES}}})({'|'.join(map(re.escape, SUFFIXES))})")
# Temporary name of a file of an entry; only a killed process leaves one behind.
UNFINISHED_FILE = re.compile(rf"\.{ENTRY_FILE.pattern}\.\d+\.tmp")
# Bytes that are hashed at once.
HASH_BLOCK = 1 << 22
# Bytes of a block that `st_blocks` counts.
DISK_BLOCK = 512


def default_folder() -> Path:
    """The folder of this program in the user's cache; a temporary one for a user without a home.

    Unknown users of containers have none. The temporary one has the user's number in its name.
    """
    import platformdirs  # most runs need no cache

    try:
        folder = platformdirs.user_cache_path("spmm_torch")
    except RuntimeError:  # the system does not know the user
        folder = Path("~")
    if folder.is_absolute():
        return folder
    user = os.getuid() if hasattr(os, "getuid") else "user"
    return Path(tempfile.gettempdir()) / f"spmm_torch-{user}"


def entry_key(parts: Iterable[object]) -> str:
    """The hash of all that the codes of an entry depend on, in hexadecimal."""
    digest = hashlib.blake2b(digest_size=KEY_BYTES)
    for part in (LAYOUT_VERSION, *parts):
        digest.update(repr(part).encode() + b"\0")
    return digest.hexdigest()


def file_hash(path: Path, block: int = HASH_BLOCK) -> str:
    """The hash of the content of a file, in hexadecimal; read in blocks of so many bytes.

    Raises:
        OSError: the file cannot be read.
    """
    digest = hashlib.blake2b(digest_size=KEY_BYTES)
    with path.open("rb") as file:
        while content := file.read(block):
            digest.update(content)
    return digest.hexdigest()


def source_content(path: Path) -> list[tuple[str, str]]:
    """Names and hashes of a file, or of all files in a folder and below that are not hidden.

    Raises:
        DataError: a file cannot be read any more.
    """
    try:
        if not path.is_dir():
            return [("", file_hash(path))]
        names = sorted(name for name in folder_files(path) if not is_hidden(name))
        return [(name, file_hash(path / name)) for name in names]
    except OSError as error:
        raise DataError(
            f"{path} cannot be read any more ({error}); expected all that was there when it was "
            f"opened; restore it and start again."
        ) from error


def entries(folder: Path | None = None) -> list[tuple[int, str, str]]:
    """The (bytes on disk, source, "whole" or "unfinished") of every entry."""
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
        rows.append((_on_disk(path), source, state))
    return rows


def clear(folder: Path | None = None) -> tuple[int, int]:
    """Removes all entries that no process holds; returns (number of files, bytes freed).

    Raises:
        OutputError: an entry cannot be removed.
    """
    folder = folder or default_folder()
    count = freed = 0
    try:
        for key in _keys(folder) if folder.is_dir() else ():
            with suppress(Timeout), locked(folder / f"{key}.lock", wait=False):
                for path in (
                    *folder.glob(f".{key}.*.tmp"),
                    *(folder / f"{key}{s}" for s in SUFFIXES),
                ):
                    if path.exists():
                        freed += _on_disk(path)
                        path.unlink()
                        count += 1
    except OSError as error:
        raise OutputError(
            f"the cache {folder} cannot be cleared ({error}); check its permissions."
        ) from error
    return count, freed


def _on_disk(path: Path) -> int:
    """Bytes that a file takes on disk, reserved space included; Windows tells its length only."""
    status = path.stat()
    blocks = getattr(status, "st_blocks", None)
    return status.st_size if blocks is None else blocks * DISK_BLOCK


def _keys(folder: Path) -> list[str]:
    """The keys of the entries in a folder, which may hold other files as well."""
    names = [path.name for path in folder.iterdir()]
    found = [kind.fullmatch(name) for kind in (ENTRY_FILE, UNFINISHED_FILE) for name in names]
    return sorted({match[1] for match in found if match})


@dataclass
class CacheEntry:
    """One entry, held by this process alone; made by `CacheEntry.open`.

    Attributes:
        folder, key: folder and name of its files.
        where: name of the source in messages.
        shape, dtype: shape (T, D, B) and type of its codes.
        views_done: number of views that it holds.
        highest: highest value so far.
        complete: whether it holds all views.
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
        """The entry of a key, as far as it is done; waits while another process holds it.

        Raises:
            OutputError: the cache cannot be written.
        """
        entry = cls(folder or default_folder(), key, where, shape, dtype)
        with ExitStack() as stack:
            with entry._output_errors():
                entry.folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(locked(entry.folder / f"{key}.lock"))
                entry._find()
            yield entry

    @contextmanager
    def _output_errors(self) -> Iterator[None]:
        """Turns errors of the system into an OutputError; for access to the cache only."""
        try:
            yield
        except OSError as error:
            raise OutputError(
                f"the cache {self.folder} cannot be written ({error}); expected a writable folder "
                f"with enough space; free some, or choose another folder with --cache."
            ) from error

    @property
    def path(self) -> Path:
        """The file of the finished codes."""
        return self.folder / f"{self.key}.npy"

    @property
    def _part(self) -> Path:
        return self.folder / f"{self.key}.npy.part"

    @property
    def _facts(self) -> Path:
        return self.folder / f"{self.key}.json"

    def _find(self) -> None:
        """Finds out what earlier processes have done; damaged files count as missing."""
        complete = self._is_whole(self.path)
        if not (complete or self._is_whole(self._part)):
            return
        try:
            facts = json.loads(self._facts.read_text(encoding="utf-8"))
            self.views_done, self.highest = int(facts["views_done"]), float(facts["highest"])
        except (
            OSError,
            ValueError,
            TypeError,
            KeyError,
        ):  # a process was killed before its first band
            return
        self.complete = complete

    def _is_whole(self, path: Path) -> bool:
        try:
            codes = np.lib.format.open_memmap(path, mode="r")
        except (OSError, ValueError, OverflowError):
            return False
        return (codes.shape, codes.dtype) == (self.shape, self.dtype)

    def reserve(self) -> None:
        """Allocates the file of all codes, so that a full disk is found out before any work.

        Raises:
            OutputError: there is not enough space, or the cache cannot be written.
        """
        if self.views_done:
            return
        with self._output_errors():
            for path in (self._facts, self.path, self._part):  # damaged or barely begun
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
            reserve(file, os.fstat(file.fileno()).st_size)

    def put(self, codes: np.ndarray, first_pair: int, *, views_done: int, highest: float) -> None:
        """Writes the codes `[T, d, B]` of some views, and notes that they are done.

        Args:
            codes: codes of consecutive direction pairs.
            first_pair: number of the first pair.
            views_done: number of views that the entry holds then.
            highest: highest value that the entry holds then.

        Raises:
            OutputError: the cache cannot be written.
        """
        pairs = slice(first_pair, first_pair + codes.shape[1])
        facts = {"source": self.where, "views_done": views_done, "highest": highest}
        with self._output_errors():
            for block in slices(len(codes), WRITTEN_TEXELS):
                # Mapped again for every block, so that pages do not stay in memory.
                np.lib.format.open_memmap(self._part, mode="r+")[block, pairs] = codes[block]
            with self._part.open("r+b") as file:  # Windows syncs no file that is read
                os.fsync(file.fileno())  # after a power cut, noted views must be there
            write_atomic(self._facts, json.dumps(facts).encode())
        self.views_done, self.highest = views_done, highest

    def finish(self) -> None:
        """Marks the entry as complete, once all views are written.

        Raises:
            OutputError: the cache cannot be written.
        """
        with self._output_errors():
            os.replace(self._part, self.path)
        self.complete = True
