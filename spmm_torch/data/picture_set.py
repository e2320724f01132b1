"""Reader of picture sets: a zip or folder of one picture for each direction pair.

File names give the directions: `<NAME>/MANYFILES/tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`
has the polar angles t and azimuths p, in degrees, of light l and view v. The first bytes of a file
give its format: JPEG, PNG and their kin (UBO2003), TIFF, Radiance (ATRIUM) or OpenEXR. Pictures of
8 and 16 bits are gamma-encoded, the others linear; all values contain the cosine of the light.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import DataError, alternatives
from .btf import BTF
from .cache import entry_key, file_hash
from .codecs import CODECS, DECODE_ERRORS, SUFFIXES, Codec, codec_of
from .directions import checked_directions
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import (
    Archive,
    PictureGrid,
    arrange,
    list_files,
    material_name,
    open_archive,
    open_zip,
    parse_angles,
    unit_vectors,
    unreadable,
)
from .store import Loading, Part, Store
from .transpose import Place, ViewSource, open_store

KINDS = alternatives([codec.TITLE for codec in reversed(CODECS)])
EXPECTED = (
    f"a zip or folder of {KINDS} pictures named by their angles "
    "(like '00008 tl000 pl000 tv030 pv030.jpg')"
)
CHANNELS = 3


def accepts(path: Path) -> bool:
    """Whether a folder or zip has at least one picture named by its directions."""
    return (path.is_dir() or zipfile.is_zipfile(path)) and any(map(_is_picture, list_files(path)))


def list_pictures(path: Path) -> list[str]:
    """Names of the pictures in a zip or folder that are named by their directions."""
    return [name for name in list_files(path) if _is_picture(name)]


def _is_picture(name: str) -> bool:
    return name.lower().endswith(SUFFIXES) and parse_angles(name) is not None


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens a picture set: reads all names, and decodes one picture only.

    Raises:
        DataError: a direction pair is missing or there twice, or the first picture is damaged.
    """
    source = Path(path)
    pictures = PictureSet.scan(source, options)
    return BTF(
        name=material_name(source),
        path=str(path),
        height=pictures.size[0],
        width=pictures.size[1],
        view=checked_directions(unit_vectors(pictures.grid.view), f"the set of views in {source}"),
        light=checked_directions(
            unit_vectors(pictures.grid.light), f"the set of lights in {source}"
        ),
        bytes_per_value=pictures.bytes_per_value,
        open_store=pictures.open_store,
        hdr=None if pictures.codec.HDR else False,
        missing=pictures.grid.missing,
    )


class WiderFloatsError(Exception):
    """A picture of single floats was met where the first one holds half floats."""


@dataclass(frozen=True)
class PictureSet:
    """All pictures of one BTF.

    Attributes:
        path: zip or folder.
        grid: directions and file names.
        codec: codec of every picture.
        size: (height, width) of every picture.
        dtype, width: type and number of the code elements of a pixel.
        options: options of the reader.
    """

    path: Path
    grid: PictureGrid
    codec: Codec
    size: tuple[int, int]
    dtype: np.dtype
    width: int
    options: ReadOptions

    @classmethod
    def scan(cls, path: Path, options: ReadOptions) -> PictureSet:
        """The picture set of a zip or folder, by its names and its first picture.

        Raises:
            DataError: a direction pair is missing or there twice, or the first picture is damaged.
        """
        grid = arrange(list_pictures(path), path, options.missing == "mask")
        with open_archive(path) as archive:
            (payload,) = archive.read([grid.first])
        codec = codec_of(payload)
        try:
            first = codec.decode(payload)
        except DECODE_ERRORS as error:
            raise unreadable(path, grid.first, error) from error
        size = (first.shape[0], first.shape[1])
        return cls(path, grid, codec, size, first.dtype, first.shape[2], options)

    @property
    def bytes_per_value(self) -> float:
        """Bytes of a value in the source; RGBE stores three values in four bytes."""
        return self.dtype.itemsize * self.width / CHANNELS

    def open_store(self, part: Part, loading: Loading) -> Store:
        """Decodes a part of the pictures.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
            OutputError: the cache cannot be written.
        """
        try:
            return self._open_store(part, loading)
        except WiderFloatsError:  # the first picture holds half floats, a later one does not
            return replace(self, dtype=np.dtype(np.float32))._open_store(part, loading)

    def _open_store(self, part: Part, loading: Loading) -> Store:
        """Decodes a part of the pictures; a WiderFloatsError if a value may not fit its type."""
        texels = self.size[0] * self.size[1] if part.texels is None else len(part.texels)
        files = self._files(part)  # [V', L'] names, None for missing ones
        shape = (len(files), len(files[0]), texels, self.width)

        def decode(views: Sequence[int], place: Place) -> None:
            threads = self.options.thread_count
            with open_archive(self.path) as archive, ThreadPoolExecutor(threads) as pool:

                def decode_view(view: int) -> None:
                    place(view, self._decode(archive, files[view], part))

                for _ in pool.map(decode_view, views):
                    pass  # raises the exception of a thread

        def key() -> str:
            chosen = [name for row in files for name in row]
            present = [name for name in chosen if name is not None]
            gaps = [place for place, name in enumerate(chosen) if name is None]
            kept = None if part.texels is None else part.texels.tolist()
            facts = (*_fingerprint(self.path, present), shape, str(self.dtype), kept)
            return entry_key((*facts, gaps) if gaps else facts)

        columns = self.size[1] if part.texels is None else 0
        expand = self.codec.expansion(self.options.gamma)
        source = ViewSource(str(self.path), shape, self.dtype, expand, decode, key, columns)
        return open_store(source, loading)

    def _files(self, part: Part) -> list[list[str | None]]:
        """File names `[V'][L']` of the pictures of a part; None for missing ones."""
        lights = len(self.grid.light)
        light_index = range(lights) if part.lights is None else part.lights.tolist()
        view_index = range(len(self.grid.view)) if part.views is None else part.views.tolist()
        return [[self.grid.files[v * lights + l] for l in light_index] for v in view_index]  # noqa: E741

    def _decode(self, archive: Archive, names: Sequence[str | None], part: Part) -> np.ndarray:
        """Codes `[L', T', B]` of the pictures of one view; missing pictures are black.

        Raises:
            DataError: a picture is damaged, or unlike the first one.
        """
        height, width = self.size
        texels = None if part.texels is None else part.texels.numpy()
        count = height * width if texels is None else len(texels)
        codes = np.zeros((len(names), count, self.width), dtype=self.dtype)
        present = {place: name for place, name in enumerate(names) if name is not None}
        payloads = archive.read(list(present.values()))
        for (place, name), payload in zip(present.items(), payloads, strict=True):
            try:
                picture = self._decode_one(payload, name)
            except DECODE_ERRORS as error:
                raise unreadable(self.path, name, error) from error
            flat = picture.reshape(height * width, self.width)
            codes[place] = flat if texels is None else flat[texels]
        return codes

    def _decode_one(self, payload: bytes, name: str) -> np.ndarray:
        """Codes `[H, W, B]` of a picture that must be like the first one."""
        codes = _codes(self.codec, payload)
        if codes.shape[:2] != self.size:
            raise DataError(
                f"picture {name!r} in {self.path} is {codes.shape[1]} x {codes.shape[0]}; "
                f"expected {self.size[1]} x {self.size[0]} like the first one; all pictures must "
                f"be registered texel by texel: replace or rescale this one."
            )
        if (codes.dtype, codes.shape[2]) != (self.dtype, self.width):
            if np.issubdtype(self.dtype, np.floating) and codes.dtype == np.float16:
                return codes.astype(self.dtype)
            if self.dtype == np.float16 and codes.dtype == np.float32:
                raise WiderFloatsError
            raise DataError(
                f"picture {name!r} in {self.path} has values of {codes.dtype}; expected "
                f"{self.dtype} like the first one; store all pictures alike."
            )
        return codes


def _codes(codec: Codec, payload: bytes) -> np.ndarray:
    """Codes `[H, W, B]` of a picture; a ValueError if it is of another codec."""
    if not codec.accepts(payload):
        raise ValueError(f"it is not stored like the first one, as {codec.TITLE}")
    return codec.decode(payload)


def _fingerprint(path: Path, names: Sequence[str]) -> list[tuple[str, int | str]]:
    """Names of some files with hashes of their content, or the checksums of a zip.

    Raises:
        DataError: a file cannot be read any more.
    """
    try:
        if path.is_dir():
            with ThreadPoolExecutor() as pool:
                hashes = pool.map(lambda name: file_hash(path / name), names)
                return list(zip(names, hashes, strict=True))
        with open_zip(path) as handle:
            return [(name, handle.getinfo(name).CRC) for name in names]
    except (OSError, KeyError) as error:
        raise DataError(
            f"a picture in {path} cannot be read any more ({error}); expected all that were there "
            f"when it was opened; restore it and start again."
        ) from error
