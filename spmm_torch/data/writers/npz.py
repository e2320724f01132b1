"""Writer of the NPZ interchange format, described in `spmm_torch.data.npz`."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib import format as npy

from ...runtime.atomic import new_file, zip_member
from .base import NoSettings, Writer
from .views import half_holds, pictures_of_views

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

HALF, SINGLE = np.dtype("<f2"), np.dtype("<f4")


def write_npz(path: Path | str, btf: BTF, progress: Progress | None = None) -> None:
    """Writes a BTF as NPZ; a failure leaves nothing.

    Sources of 16 bits become float16 where that holds every value exactly; others become float32.
    `progress(done, total)` counts views.

    Raises:
        OutputError: the file cannot be written.
    """
    with new_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        small = {"view": btf.view.numpy(), "light": btf.light.numpy()}
        if btf.names is not None:
            small["names"] = np.array(btf.names)
        for key, array in small.items():
            with archive.open(zip_member(f"{key}.npy"), "w") as stream:
                npy.write_array(stream, array, allow_pickle=False)
        _write_values(archive, btf, progress)


def _write_values(archive: zipfile.ZipFile, btf: BTF, progress: Progress | None) -> None:
    """Writes the values `[V, L, H, W, 3]`, view by view."""
    dtype = HALF if btf.bytes_per_value == HALF.itemsize and half_holds(btf) else SINGLE
    shape = (len(btf.view), len(btf.light), btf.height, btf.width, btf.channels)
    header = {"descr": npy.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    with archive.open(zip_member("values.npy"), "w", force_zip64=True) as stream:
        npy.write_array_header_1_0(stream, header)
        for pictures in pictures_of_views(btf, progress):
            for picture in pictures:  # [H, W, 3]
                stream.write(picture.astype(dtype, order="C").tobytes())


def write(
    path: Path | str, btf: BTF, settings: NoSettings, progress: Progress | None = None
) -> None:
    """Writes a BTF as NPZ; see `write_npz`."""
    write_npz(path, btf, progress)


WRITER = Writer("npz", "NPZ file", ".npz", "views", NoSettings, write)
