"""Parser of the directions and the size of the pictures of a UBO2014 file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .cursor import Cursor

# Largest number of directions, as their pairwise check takes memory of its square; domes have a few
# hundred.
MAX_DIRECTIONS = 2048
# Tolerance of polar angles in radians, as in `checked_directions`: pi / 2 in float32 is too large.
POLAR_TOLERANCE = 1e-3
# Largest difference of the light lists of two views, in radians (0.06 degrees).
SAME_ANGLE = 1e-3


def read_sampling(cursor: Cursor) -> dict[str, Any]:
    """The fields `view`, `light`, `width` and `height` of the header.

    Raises:
        DataError: the file ends early, lights differ between views, or an angle is not valid.
    """
    view_count = cursor.count("views", MAX_DIRECTIONS)
    start = cursor.position
    # The first record has the size of all, as every view has the same lights.
    cursor.skip(8, "the angles of view 0")
    light_count = cursor.count("lights of view 0", MAX_DIRECTIONS)
    record = np.dtype([("view", "<f4", 2), ("count", "<u4"), ("light", "<f4", (light_count, 2))])
    cursor.rewind(start)
    records = cursor.array(record, view_count, "the list of views and lights")
    _check_records(cursor, records, start)
    return {
        "view": records["view"].copy(),
        "light": records["light"][0].copy(),
        "width": cursor.count("columns of the pictures"),
        "height": cursor.count("rows of the pictures"),
    }


def _check_records(cursor: Cursor, records: np.ndarray, start: int) -> None:
    """Refuses light lists that differ between views, and angles that are no directions.

    Args:
        cursor: reader, for messages.
        records: record (view, count, light) of each view.
        start: offset of the first record in bytes.
    """
    lights = records["light"]  # [V, L, 2]
    size, light_count = records.itemsize, lights.shape[1]
    other = np.flatnonzero(records["count"] != light_count)
    if len(other):
        raise cursor.error(
            f"has {records['count'][other[0]]} lights under view {other[0]}",
            start + int(other[0]) * size + 8,
            f"{light_count} as under view 0",
        )
    for kind, angles, offset in (("view", records["view"], 0), ("light", lights[0], 12)):
        polar = angles[:, 0]
        upper = (polar >= -POLAR_TOLERANCE) & (polar <= math.pi / 2 + POLAR_TOLERANCE)
        bad = np.flatnonzero(~(upper & np.isfinite(angles[:, 1])))
        if len(bad):
            stride = size if kind == "view" else 8
            raise cursor.error(
                f"has {kind} {bad[0]} at polar angle {polar[bad[0]]:g}, azimuth "
                f"{angles[bad[0], 1]:g} radians",
                start + offset + int(bad[0]) * stride,
                "finite angles, the polar one from 0 to pi/2",
            )
    with np.errstate(all="ignore"):  # the other lists are unchecked
        same = np.abs(lights - lights[0]) <= SAME_ANGLE  # [V, L, 2]
    strange = np.argwhere(~same.all(-1))
    if len(strange):
        view, light = (int(index) for index in strange[0])
        raise cursor.error(
            f"has another light {light} under view {view} than under view 0",
            start + view * size + 12 + 8 * light,
            "the same lights under every view",
        )
