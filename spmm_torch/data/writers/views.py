"""Access of writers to a BTF: pictures view by view, and the range of values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...errors import DataError

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

MAX_HALF = float(np.finfo(np.float16).max)  # 65504; larger values would become infinite


def pictures_of_views(btf: BTF, progress: Progress | None) -> Iterator[np.ndarray]:
    """The linear pictures `[L, H, W, 3]` float32 of each view.

    `progress(done, total)` is called when the caller asks for the next view.

    Raises:
        DataError: pairs are missing.
    """
    refuse_gaps(btf)
    count = len(btf.view)
    for view in range(count):
        # Texels are apart in memory: one copy is faster than scattered reads of each picture.
        yield btf.pictures(view).contiguous().numpy()
        if progress is not None:
            progress(view + 1, count)


def refuse_gaps(btf: BTF) -> None:
    """Refuses a BTF with missing pairs, which files would hold as black.

    Raises:
        DataError: pairs are missing.
    """
    if btf.missing is not None:
        raise DataError(
            f"{btf.path or btf.name} has no values at {btf.pair_count - btf.measured_count} of its "
            f"{btf.pair_count} pairs of directions; expected values at all, as files cannot tell "
            f"what is missing from what is black; fit it as it is."
        )


def fits_half(btf: BTF) -> bool:
    """Whether no value exceeds the largest half float; reads all values of an HDR BTF."""
    if not btf.is_hdr:
        return True
    return all(float(btf.pictures(view).max()) <= MAX_HALF for view in range(len(btf.view)))
