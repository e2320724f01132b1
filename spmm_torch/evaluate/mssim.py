"""MSSIM as in the paper: structural similarity of Y, Cr and Cb [WDR11 §4.2]."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.ndimage import minimum_filter
from torch import Tensor

from .renderings import Renderings

# Wang's window: a Gaussian of this deviation, 11 x 11 pixels [WBS*04 §III.B].
SIGMA, WINDOW = 1.5, 11
CHANNELS = ("y", "cr", "cb")
# The codes of video, which scikit-image gives: the lowest, and the range of Y, Cb and Cr.
LOWEST_CODE, CODES = 16.0, (219.0, 224.0, 224.0)

Score = dict[str, float]


def mssim(spheres: Renderings) -> list[Score]:
    """The mean structural similarity of each pair of sphere pictures: `y`, `cr`, `cb`, `mean`.

    Pictures, lights, exposure and tone curve are those of `spheres`. Tone-mapped RGB in 0..1 is
    converted to full-range Y, Cr and Cb by the matrix of ITU-R BT.601. Each channel is compared
    with the parameters of [WBS*04]: a Gaussian window of 11 x 11 pixels and deviation 1.5,
    covariances divided by N, K1 = 0.01, K2 = 0.03 and a range of 1. The mean is taken over the
    pixels whose whole window counts in `Renderings.counts`, which leaves out the background and the
    unlit side, black in both pictures. `mean` is over the three channels.
    """
    scores = []
    for original, model, counts in zip(*spheres.shown(), spheres.counts, strict=True):
        whole = minimum_filter(counts.numpy(), WINDOW, mode="constant", cval=0).astype(bool)
        planes = zip(y_cr_cb(original), y_cr_cb(model), strict=True)
        values = [float(ssim_map(*pair)[whole].mean()) for pair in planes]
        scores.append(dict(zip(CHANNELS, values, strict=True), mean=sum(values) / len(values)))
    return scores


def mean_score(scores: Iterable[Score]) -> Score:
    """The mean of the scores of all pictures, for each channel."""
    rows = list(scores)
    return {key: sum(row[key] for row in rows) / len(rows) for key in (*CHANNELS, "mean")}


def y_cr_cb(picture: Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Y, Cr and Cb, each `[H, W]` float64 in 0..1, of display values `[H, W, 3]`."""
    # Imported here, since scikit-image is slow to load.
    from skimage.color import rgb2ycbcr

    codes = rgb2ycbcr(picture.double().numpy())
    y, cb, cr = np.moveaxis((codes - LOWEST_CODE) / CODES, -1, 0)
    return y, cr, cb


def ssim_map(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The structural similarity `[H, W]` around each pixel of two planes in 0..1."""
    # Imported here, since scikit-image is slow to load.
    from skimage.metrics import structural_similarity

    found = structural_similarity(
        first,
        second,
        gaussian_weights=True,
        sigma=SIGMA,
        use_sample_covariance=False,
        data_range=1.0,
        full=True,
    )
    return np.asarray(found[1])
