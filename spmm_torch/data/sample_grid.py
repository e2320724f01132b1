"""The grid of lights and views that a list of samples fills, where it fills one but for gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ..errors import DataError
from .directions import SAME_DIRECTION

# A grid has at most so many pairs, and samples at so large a part of them: a fit takes time and
# memory for each pair of a grid, with a sample or not. More distinct directions are never one.
MAX_PAIRS, LEAST_FILL, MAX_DISTINCT = 1 << 17, 0.25, 1 << 16


@dataclass(frozen=True)
class Samples:
    """A list of N samples.

    Attributes:
        wi, wo: unit directions to light and view, `[N, 3]`.
        rgb: values, `[N, 3]`.
        texel: of each sample, `[N]`.
        size: (height, width) of the texture; one row where texels are no texture.
        names: of the texels; None for a texture.
    """

    wi: np.ndarray
    wo: np.ndarray
    rgb: np.ndarray
    texel: np.ndarray
    size: tuple[int, int]
    names: tuple[str, ...] | None


@dataclass(frozen=True)
class Grid:
    """Samples on a grid.

    Attributes:
        view, light: distinct directions, `[V, 3]`, `[L, 3]`.
        values: `[V, L, T, 3]`, NaN without a sample.
        missing: pairs that count for no texel, `[V, L]`.
    """

    view: np.ndarray
    light: np.ndarray
    values: np.ndarray
    missing: np.ndarray


def grid_of(samples: Samples, mask: bool, path: Path) -> Grid | None:
    """The grid that the samples fill; None if they fill none, or texels have other pairs of it.

    Args:
        samples: of all texels; those of one texel and pair are averaged.
        mask: whether pairs that a texel lacks count for no texel.
        path: of the file, for messages.
    """
    _check_finite(samples.wo, f"'wo' of {path}")
    _check_finite(samples.wi, f"'wi' of {path}")
    view, at_view = _distinct(samples.wo)
    light, at_light = _distinct(samples.wi)
    count, texels = len(view) * len(light), math.prod(samples.size)
    # Every texel needs a sample at that part of the pairs: fewer samples are refused before
    # anything is made for each pair of each texel.
    if not 0 < count <= min(MAX_PAIRS, len(samples.rgb) / (LEAST_FILL * texels)):
        return None
    shape = (len(view), len(light), texels)
    place = np.ravel_multi_index((at_view, at_light, samples.texel), shape)
    number = np.bincount(place, minlength=math.prod(shape))
    lacking = (number == 0).reshape(shape)  # [V, L, T]
    everywhere, somewhere = lacking.all(axis=-1), lacking.any(axis=-1)
    same = mask or bool((everywhere == somewhere).all())
    if not same or (~somewhere).sum() < LEAST_FILL * count:
        return None
    total = np.zeros((math.prod(shape), 3))
    np.add.at(total, place, samples.rgb)
    values = np.where(number[:, None] > 0, total / np.maximum(number, 1)[:, None], np.nan)
    return Grid(view, light, values.astype(np.float32).reshape(*shape, 3), somewhere)


def _distinct(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions `[M, 3]` of which no two are the same, and which one each of `[N, 3]` is.

    No directions, M = 0, if there are more than a grid may have.
    """
    exact, back = np.unique(directions, axis=0, return_inverse=True)
    if len(exact) > MAX_DISTINCT:
        return exact[:0], back
    near = KDTree(exact).query_pairs(SAME_DIRECTION, output_type="ndarray")
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(exact),) * 2)
    _, group = connected_components(links, directed=False)
    _, first, order = np.unique(group, return_index=True, return_inverse=True)
    return exact[first], order[back.reshape(-1)]


def _check_finite(directions: np.ndarray, where: str) -> None:
    if not np.isfinite(directions).all():
        raise DataError(
            f"{where} holds a direction that is not finite, the first at sample "
            f"{int(np.argwhere(~np.isfinite(directions))[0, 0])}; expected unit vectors; remove it."
        )
