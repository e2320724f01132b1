"""Reader of tabulated BRDFs: MERL `.binary` and RGL `.bsdf`, one file or a folder or zip of them.

Each file is one texel, in the order of the names; texels are no neighbours. Tables are read at the
directions of `ReadOptions.rings`, and multiplied by the cosine of the light where they lack it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path, PurePosixPath

import numpy as np
import torch
from torch import Tensor

from ...errors import DataError
from ...geometry.directions import (
    UBO2003_RINGS,
    UBO2014_RINGS,
    direction_pairs,
    ring_directions,
)
from ..arrays import opener_in_memory
from ..btf import BTF
from ..left_out import left_out_notes
from ..options import DEFAULT_OPTIONS, ReadOptions
from ..pictures import is_container, list_files, material_name, open_archive
from ..store import Loading, Part, Store
from . import merl, rgl

EXPECTED = "MERL .binary or RGL .bsdf files, one or a folder or zip of them"
SUFFIXES = (merl.SUFFIX, rgl.SUFFIX)
HEADERS = (merl.HEADER, rgl.HEADER)
# Directions at which tables are read, by their number.
RINGS = {81: UBO2003_RINGS, 151: UBO2014_RINGS}
BYTES_PER_VALUE = 4  # of float32

Evaluate = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (wi, wo [Q, 3]) to values [Q, 3]


def accepts(path: Path) -> bool:
    """Whether a file is such a table by suffix or first bytes, or a folder or zip holds one."""
    if is_container(path):
        return any(map(is_table, list_files(path)))
    if is_table(path.name):
        return True
    with path.open("rb") as stream:
        return stream.read(max(map(len, HEADERS))).startswith(HEADERS)


def is_table(name: str) -> bool:
    """Whether a file is a table by its name."""
    return name.lower().endswith(SUFFIXES)


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens tables: reads their names, and the tables too where missing values are masked.

    Raises:
        DataError: a table is damaged, where it has to be read.
    """
    source = Path(path)
    tables = Tables.scan(source, ring_directions(RINGS[options.rings]))
    beside = list_files(source) if is_container(source) else []
    missing = tables.missing() if options.missing == "mask" else None
    return BTF(
        name=material_name(source),
        path=str(path),
        height=1,
        width=len(tables.files),
        view=tables.directions,
        light=tables.directions,
        bytes_per_value=BYTES_PER_VALUE,
        open_store=partial(tables.open_store, missing=missing),
        hdr=None,
        missing=missing,
        names=tables.names,
        notes=left_out_notes(source, beside, tables.files),
    )


@dataclass(frozen=True)
class Tables:
    """The tables at a path, and the directions at which they are read.

    Attributes:
        path: one file, or a folder or zip.
        files: names below the path; that of the file itself where it is one.
        directions: views and lights alike, `[V, 3]`.
    """

    path: Path
    files: tuple[str, ...]
    directions: Tensor

    @classmethod
    def scan(cls, path: Path, directions: Tensor) -> Tables:
        """All tables of a path, in the order of their names, to be read at `directions [V, 3]`."""
        if not is_container(path):
            return cls(path, (path.name,), directions)
        return cls(path, tuple(filter(is_table, list_files(path))), directions)

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each table: that of its file, with the folder only where two are alike."""
        stems = [PurePosixPath(file).stem for file in self.files]
        uses = Counter(stems)
        return tuple(
            stem if uses[stem] == 1 else str(PurePosixPath(file).with_suffix(""))
            for stem, file in zip(stems, self.files, strict=True)
        )

    def missing(self) -> Tensor | None:
        """Pairs `[V, L]` that any table lacks; None if all have all."""
        lacking = np.isnan(self._all).any((2, 3))  # [V, L]
        return torch.from_numpy(lacking) if lacking.any() else None

    @cached_property
    def _all(self) -> np.ndarray:
        """Values `[V, L, T, 3]` of all tables; NaN where one has none."""
        return self.values(self.files)

    def values(self, files: tuple[str, ...]) -> np.ndarray:
        """Values `[V, L, T, 3]` float32 of some tables; NaN where one has none.

        Raises:
            DataError: a file cannot be read, or is damaged.
        """
        count = len(self.directions)
        wi, wo = (each.double().numpy() for each in direction_pairs(*[self.directions] * 2))
        values = np.empty((len(wi), len(files), 3), np.float32)
        for place, (name, payload) in enumerate(self._payloads(files)):
            values[:, place] = table_of(payload, name, self._where(name))(wi, wo)
        return values.reshape(count, count, len(files), 3)

    @property
    def _is_one(self) -> bool:
        """Whether the path is that of a table itself."""
        return not is_container(self.path)

    def _where(self, file: str) -> str:
        """A table in messages."""
        return str(self.path) if self._is_one else f"{file!r} in {self.path}"

    def _payloads(self, files: tuple[str, ...]) -> Iterator[tuple[str, bytes]]:
        """The name and content of each file, one after the other."""
        if self._is_one:
            yield files[0], self.path.read_bytes()
            return
        with open_archive(self.path) as archive:
            for file in files:
                yield file, archive.read([file])[0]

    def open_store(self, part: Part, loading: Loading, missing: Tensor | None = None) -> Store:
        """Reads the tables of a part.

        Args:
            part: which texels, views and lights.
            loading: options of the decoding.
            missing: pairs `[V, L]` that are masked; None: none may be missing.

        Raises:
            DataError: a table is damaged, or has no value or one that is not valid.
            OutputError: the cache cannot be written.
        """
        chosen = range(len(self.files)) if part.texels is None else part.texels.tolist()
        files = tuple(self.files[index] for index in chosen)
        values = self._all if "_all" in vars(self) and part.texels is None else self.values(files)
        if missing is not None:
            values = np.where(missing.numpy()[:, :, None, None], np.float32(0.0), values)
        self._check(values, files, loading.negative)
        opener = opener_in_memory(values[:, :, None], str(self.path))  # [V, L, 1, T, 3]
        return opener(Part(None, part.views, part.lights), loading)

    def _check(self, values: np.ndarray, files: tuple[str, ...], negative: str) -> None:
        """Refuses `values [V, L, T, 3]` that are missing, or below zero where that is not allowed.

        Raises:
            DataError: naming the file and the first such pair.
        """
        for bad, what, remedy in (
            (
                np.isnan(values),
                "no value",
                "give data.missing=mask (--set of a fit), or leave the file out",
            ),
            (
                (values < 0.0) & (negative == "refuse"),
                "values below zero",
                "give data.negative (--set of a fit, else --negative) as keep or clip",
            ),
        ):
            if bad.any():
                view, light, texel, _ = np.argwhere(bad)[0].tolist()
                pairs = int(bad[:, :, texel].any(-1).sum())
                raise DataError(
                    f"{self._where(files[texel])} has {what} at {pairs} of "
                    f"{bad.shape[0] * bad.shape[1]} pairs of directions, the first being view "
                    f"{view}, light {light}; expected values that are not negative; {remedy}."
                )


def table_of(payload: bytes, name: str, where: str) -> Evaluate:
    """The function of a table: the BRDF times the cosine of the light, NaN where not measured.

    Args:
        payload: content of the file.
        name: of the file, whose suffix tells the format where the first bytes do not.
        where: the file in messages.

    Raises:
        DataError: the table is damaged.
    """
    if payload.startswith(rgl.HEADER) or name.lower().endswith(rgl.SUFFIX):
        return rgl.parse(payload, where).eval
    table = merl.read_table(payload, where)

    def cosine_weighted(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return merl.evaluate(table, wi, wo) * wi[:, 2:]

    return cosine_weighted
