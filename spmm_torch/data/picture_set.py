"""Reader of picture sets: a zip or folder of one picture for each direction pair.

File names give the directions: `<NAME>/MANYFILES/tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`
has the polar angles t and azimuths p, in degrees, of light l and view v; other names are read by a
pattern. The first bytes of a file give its format: JPEG, PNG and their kin (UBO2003), TIFF,
Radiance (ATRIUM) or OpenEXR. Pictures of 8 and 16 bits are gamma-encoded, the others linear; all
values contain the cosine of the light.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from torch import Tensor

from ..errors import DataError
from .btf import BTF
from .cache import entry_key, file_hash
from .directions import checked_directions
from .left_out import left_out_notes
from .named_pictures import EXPECTED, find_grid, list_pictures
from .options import DEFAULT_OPTIONS, ReadOptions
from .picture_form import PictureForm, WiderFloatsError
from .picture_grid import PictureGrid, hole_notes, unit_vectors
from .pictures import is_container, list_files, material_name, open_archive
from .stated_colour import colour_notes
from .store import Loading, Part, ScaledStore, Store
from .transpose import Place, ViewSource, open_store

__all__ = ["EXPECTED", "PictureSet", "accepts", "read"]

CHANNELS = 3


def accepts(path: Path) -> bool:
    """Whether a folder or zip has at least one picture named by its directions."""
    return is_container(path) and bool(list_pictures(path))


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens a picture set: reads all names, and decodes one picture only.

    Raises:
        DataError: a direction pair is missing or there twice, no name is like the pattern, or the
            first picture is damaged.
    """
    source = Path(path)
    files = list_files(source)
    grid = find_grid(source, files, options)
    notes = hole_notes(grid) + left_out_notes(source, files, grid.files, options.pattern)
    return PictureSet.of(source, grid, options).btf(str(path), material_name(source), notes)


@dataclass(frozen=True)
class PictureSet:
    """All pictures of one BTF.

    Attributes:
        path: zip or folder.
        grid: directions and file names.
        form: of every picture.
        options: options of the reader.
        intensity: intensity of each light by channel, which values are divided by, `[L, 3]`; None:
            all lights are alike.
        notes: lines about the first picture.
    """

    path: Path
    grid: PictureGrid
    form: PictureForm
    options: ReadOptions
    intensity: Tensor | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def scan(cls, path: Path, options: ReadOptions) -> PictureSet:
        """The picture set of a zip or folder, by its names and its first picture.

        Raises:
            DataError: a direction pair is missing or there twice, or the first picture is damaged.
        """
        return cls.of(path, find_grid(path, list_files(path), options), options)

    @classmethod
    def of(
        cls,
        path: Path,
        grid: PictureGrid,
        options: ReadOptions,
        intensity: Tensor | None = None,
    ) -> PictureSet:
        """The picture set of a grid, by its first picture.

        Args:
            path: zip or folder.
            grid: directions and file names.
            options: options of the reader.
            intensity: see `PictureSet`, `[L, 3]`.

        Raises:
            DataError: a member of the zip has a form that cannot be read, or the first picture is
                damaged.
        """
        with open_archive(path) as archive:
            archive.check([name for name in grid.files if name is not None])
            (payload,) = archive.read([grid.first])
        form = PictureForm.of(path, grid.first, payload)
        linear = np.issubdtype(form.dtype, np.floating)
        notes = () if linear else colour_notes(payload, options.gamma)
        return cls(path, grid, form, options, intensity, notes)

    def btf(self, path: str, name: str, notes: tuple[str, ...] = ()) -> BTF:
        """The BTF of these pictures.

        Args:
            path: as the user gave it.
            name: of the material.
            notes: lines about the input.

        Raises:
            DataError: two directions are the same.
        """
        return BTF(
            name=name,
            path=path,
            height=self.form.size[0],
            width=self.form.size[1],
            view=checked_directions(unit_vectors(self.grid.view), f"the set of views in {path}"),
            light=checked_directions(unit_vectors(self.grid.light), f"the set of lights in {path}"),
            bytes_per_value=self.bytes_per_value,
            open_store=self.open_store,
            hdr=None if self.form.codec.HDR or self.intensity is not None else False,
            missing=self.grid.missing,
            notes=self.notes + notes,
            content=self.content,
        )

    @property
    def bytes_per_value(self) -> float:
        """Bytes of a value in the source; RGBE stores three values in four bytes."""
        return self.form.dtype.itemsize * self.form.width / CHANNELS

    def content(self) -> object:
        """Names of all pictures with hashes or checksums of them, and intensities of the lights.

        Raises:
            DataError: a picture cannot be read any more.
        """
        names = [name for name in self.grid.files if name is not None]
        intensity = None if self.intensity is None else self.intensity.tolist()
        return _fingerprint(self.path, names), intensity

    def open_store(self, part: Part, loading: Loading) -> Store:
        """Decodes a part of the pictures.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
            OutputError: the cache cannot be written.
        """
        try:
            return self._open_store(part, loading)
        except WiderFloatsError:  # the first picture holds half floats, a later one does not
            wider = replace(self.form, dtype=np.dtype(np.float32))
            return replace(self, form=wider)._open_store(part, loading)

    def _open_store(self, part: Part, loading: Loading) -> Store:
        """Decodes a part of the pictures; a WiderFloatsError if a value may not fit its type."""
        texels = self.form.size[0] * self.form.size[1] if part.texels is None else len(part.texels)
        files = self._files(part)  # [V', L'] names, None for missing ones
        shape = (len(files), len(files[0]), texels, self.form.width)

        def decode(views: Sequence[int], place: Place) -> None:
            threads = self.options.thread_count
            with open_archive(self.path) as archive, ThreadPoolExecutor(threads) as pool:

                def decode_view(view: int) -> None:
                    place(view, self.form.decode(archive, files[view], part.texels))

                for _ in pool.map(decode_view, views):
                    pass  # raises the exception of a thread

        def key() -> str:
            chosen = [name for row in files for name in row]
            present = [name for name in chosen if name is not None]
            gaps = [place for place, name in enumerate(chosen) if name is None]
            kept = None if part.texels is None else part.texels.tolist()
            facts = (*_fingerprint(self.path, present), shape, str(self.form.dtype), kept)
            return entry_key((*facts, gaps) if gaps else facts)

        columns = self.form.size[1] if part.texels is None else 0
        expand = self.form.codec.expansion(self.options.gamma)
        source = ViewSource(str(self.path), shape, self.form.dtype, expand, decode, key, columns)
        store = open_store(source, loading)
        if self.intensity is None:
            return store
        intensity = self.intensity if part.lights is None else self.intensity[part.lights]
        return ScaledStore(store, 1.0 / intensity, len(files))

    def _files(self, part: Part) -> list[list[str | None]]:
        """File names `[V'][L']` of the pictures of a part; None for missing ones."""
        lights = len(self.grid.light)
        light_index = range(lights) if part.lights is None else part.lights.tolist()
        view_index = range(len(self.grid.view)) if part.views is None else part.views.tolist()
        return [[self.grid.files[v * lights + l] for l in light_index] for v in view_index]  # noqa: E741


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
        with open_archive(path) as archive:
            return [(name, archive.checksum(name)) for name in names]
    except (OSError, KeyError) as error:
        raise DataError(
            f"a picture in {path} cannot be read any more ({error}); expected all that were there "
            f"when it was opened; restore it and start again."
        ) from error
