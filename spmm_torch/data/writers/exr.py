"""Writer of folders of OpenEXR pictures, one for each direction pair, named by its angles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...runtime.atomic import new_folder
from .base import NoSettings, Writer
from .names import picture_names
from .views import half_holds, pictures_of_views

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

SUFFIX = ".exr"
CODE_BYTES = 1


def write_exr_folder(path: Path | str, btf: BTF, progress: Progress | None = None) -> None:
    """Writes a BTF as a folder of EXR pictures; a failure leaves nothing.

    Sources of 8 bits become half floats, whose steps are far finer than theirs. So do others whose
    values half floats hold exactly; all others become single floats. `progress(done, total)` counts
    views.

    Raises:
        OutputError: the folder exists or cannot be written.
    """
    from ..codecs import openexr

    names = picture_names(btf.view, btf.light, SUFFIX)
    with new_folder(path) as folder:
        is_half = btf.bytes_per_value == CODE_BYTES or half_holds(btf)
        dtype = np.float16 if is_half else np.float32
        for row, pictures in zip(names, pictures_of_views(btf, progress), strict=True):
            (folder / row[0]).parent.mkdir()
            for name, picture in zip(row, pictures, strict=True):
                (folder / name).write_bytes(openexr.encode(picture.astype(dtype)))


def write(
    path: Path | str, btf: BTF, settings: NoSettings, progress: Progress | None = None
) -> None:
    """Writes a BTF as a folder of EXR pictures; see `write_exr_folder`."""
    write_exr_folder(path, btf, progress)


WRITER = Writer("exr", "folder of EXR pictures", "", "views", NoSettings, write)
