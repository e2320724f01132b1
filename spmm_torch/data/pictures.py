"""Folders and zips of pictures that are named by their directions, as in UBO2003 and ATRIUM."""

from __future__ import annotations

import re
import threading
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import DataError
from ..geometry.directions import direction_from_angles
from ..runtime.atomic import readable

Direction = tuple[float, float]  # (theta, phi) in degrees, as in file names

# "tl015", "pv_60", "tv 7.5": theta or phi of light or view, then degrees.
ANGLE = re.compile(r"(?<![a-z])([tp][lv])[ _]*(-?\d+(?:\.\d+)?)", re.IGNORECASE)
ZIP_ERRORS = (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError)


@dataclass(frozen=True)
class PictureGrid:
    """The pictures of every light under every view.

    Attributes:
        view, light: directions (theta, phi) in degrees, V and L of them.
        files: file names in the order d = view * L + light; None for a pair without a picture.
    """

    view: tuple[Direction, ...]
    light: tuple[Direction, ...]
    files: tuple[str | None, ...]

    @property
    def first(self) -> str:
        """The name of the first picture."""
        return next(name for name in self.files if name is not None)

    @property
    def missing(self) -> Tensor | None:
        """Whether each pair lacks a picture, `[V, L]` bool; None if none does."""
        if None not in self.files:
            return None
        flat = torch.tensor([name is None for name in self.files])
        return flat.view(len(self.view), len(self.light))


class Archive:
    """Reader of the members of a zip or the files of a folder; threads may share it."""

    def __init__(self, path: Path, handle: zipfile.ZipFile | None) -> None:
        self._path = path
        self._handle = handle
        # A ZipFile does not lock the count of its readers.
        self._lock = threading.Lock()

    def read(self, names: Sequence[str]) -> list[bytes]:
        """The contents of some files, read in one go.

        Raises:
            DataError: a file cannot be read.
        """
        if self._handle is None:
            return [self._read_file(name) for name in names]
        with self._lock:
            return [self._read_member(self._handle, name) for name in names]

    def _read_file(self, name: str) -> bytes:
        try:
            return (self._path / name).read_bytes()
        except OSError as error:
            raise unreadable(self._path, name, error) from error

    def _read_member(self, handle: zipfile.ZipFile, name: str) -> bytes:
        try:
            return handle.read(name)
        except (*ZIP_ERRORS, OSError, KeyError) as error:
            raise unreadable(self._path, name, error) from error


def unreadable(path: Path, name: str, error: Exception) -> DataError:
    """The error for a picture that cannot be read or decoded."""
    return DataError(
        f"picture {name!r} in {path} cannot be read ({error}); expected a complete picture; "
        f"restore this file from the original data set."
    )


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Opens a folder or a zip for reading.

    Raises:
        DataError: the zip is damaged.
    """
    if path.is_dir():
        yield Archive(path, None)
        return
    with open_zip(path) as handle:
        yield Archive(path, handle)


def open_zip(path: Path) -> zipfile.ZipFile:
    """Opens a zip for reading.

    Raises:
        DataError: the zip is damaged or cannot be read.
    """
    try:
        return zipfile.ZipFile(path)
    except (*ZIP_ERRORS, OSError) as error:
        raise DataError(
            f"{path} cannot be opened ({error}); expected a complete zip or a folder; "
            f"check that it is still there, or copy it again."
        ) from error


def list_files(path: Path) -> list[str]:
    """Sorted relative names of the files of a zip or folder, without hidden and macOS files.

    Raises:
        DataError: the zip is damaged or cannot be read.
    """
    if path.is_dir():
        names = [file.relative_to(path).as_posix() for file in path.rglob("*") if file.is_file()]
    else:
        with open_zip(path) as handle:
            names = [info.filename for info in handle.infolist() if not info.is_dir()]
    return sorted(name for name in names if not _is_hidden(name))


def _is_hidden(name: str) -> bool:
    return any(part.startswith(".") or part == "__MACOSX" for part in name.split("/"))


def parse_angles(name: str) -> tuple[Direction, Direction] | None:
    """The directions (view, light) in a file name, in degrees; None if there are none.

    Only the base name counts. Its four angles are in any order, with any number of digits.
    """
    found = ANGLE.findall(name.rpartition("/")[2])
    angle = {key.lower(): float(value) for key, value in found}
    if len(found) != 4 or len(angle) != 4:
        return None
    return _direction(angle["tv"], angle["pv"]), _direction(angle["tl"], angle["pl"])


def material_name(path: Path) -> str:
    """A short name of the material at a path: that of the folder, or of the file without suffix."""
    resolved = path.resolve()
    return readable(resolved.name if resolved.is_dir() else resolved.stem)


def _direction(theta: float, phi: float) -> Direction:
    """The direction with an azimuth in [0, 360) degrees, 0 at the pole."""
    return theta, (0.0 if theta == 0.0 else phi % 360.0)


def arrange(names: Iterable[str], path: Path, mask: bool = False) -> PictureGrid:
    """Arranges pictures by all pairs of their views and lights.

    Args:
        names: file names of the pictures.
        path: zip or folder of the pictures, for messages.
        mask: whether pairs may be missing.

    Raises:
        DataError: a direction pair is missing or there twice, or a direction is below the horizon.
    """
    files: dict[tuple[Direction, Direction], str] = {}
    for name in names:
        pair = parse_angles(name)
        if pair is None:
            continue
        _check_above_horizon(pair, name, path)
        if pair in files:
            raise DataError(
                f"{path} holds {_describe(pair)} twice, as {files[pair]!r} and {name!r}; expected "
                f"each direction pair once; remove one of them, or split two materials."
            )
        files[pair] = name
    view = tuple(sorted({pair[0] for pair in files}))
    light = tuple(sorted({pair[1] for pair in files}))
    product = [(v, l) for v in view for l in light]  # noqa: E741
    missing = [pair for pair in product if pair not in files]
    if missing and not mask:
        raise DataError(
            f"{path} lacks {_describe(missing[0])} ({len(missing)} missing of {len(product)} "
            f"pairs = {len(view)} views x {len(light)} lights); expected a picture of every light "
            f"under every view; add the missing pictures, remove the misnamed ones, or go on "
            f"without them by data.missing=mask."
        )
    return PictureGrid(view, light, tuple(files.get(pair) for pair in product))


def _check_above_horizon(pair: tuple[Direction, Direction], name: str, path: Path) -> None:
    for theta, _ in pair:
        if not 0.0 <= theta <= 90.0:
            raise DataError(
                f"picture {name!r} in {path} has a polar angle of {theta:g} degrees, under the "
                f"horizon; expected 0 to 90, counted from the surface normal; rename or remove it."
            )


def _describe(pair: tuple[Direction, Direction]) -> str:
    """The pair (view, light) in words."""
    (view_theta, view_phi), (light_theta, light_phi) = pair
    return (
        f"the pair light (theta {light_theta:g}, phi {light_phi:g}), "
        f"view (theta {view_theta:g}, phi {view_phi:g})"
    )


def unit_vectors(directions: Sequence[Direction]) -> Tensor:
    """Unit vectors `[N, 3]` float32 of N directions in degrees."""
    theta, phi = torch.deg2rad(torch.tensor(directions, dtype=torch.float64)).unbind(-1)
    return direction_from_angles(theta, phi).float()
