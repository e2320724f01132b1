"""Access of writers to a BTF: pictures view by view, and the range of values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...errors import DataError

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

HALF_BYTES = 2


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


def half_holds(btf: BTF) -> bool:
    """Whether half floats hold every value exactly; reads all values if so.

    They do not where a value is out of their range, or comes from integers of 16 bits.
    """
    if btf.bytes_per_value > HALF_BYTES:
        return False
    views = (btf.pictures(view).numpy() for view in range(len(btf.view)))
    with np.errstate(over="ignore"):  # becomes infinite, and is not equal
        return all(np.array_equal(pictures.astype(np.float16), pictures) for pictures in views)
