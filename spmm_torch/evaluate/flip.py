"""FLIP: how different two pictures look where one alternates between them."""

from __future__ import annotations

import numpy as np

from .spheres import Spheres


def flip(spheres: Spheres) -> list[float] | None:
    """The mean FLIP error of each pair of sphere pictures; None without the extra `eval`.

    0 means that they look the same. Tone-mapped as for MSSIM, over the pixels that count, at 67
    pixels a degree, which is the default of [Andersson et al. 2020, FLIP: A Difference Evaluator
    for Alternating Images].
    """
    try:
        import flip_evaluator
    except ImportError:
        return None
    errors = []
    for original, model, counts in zip(*spheres.shown(), spheres.counts, strict=True):
        pictures = (np.ascontiguousarray(shown.float().numpy()) for shown in (original, model))
        error, _, _ = flip_evaluator.evaluate(
            *pictures, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False
        )  # [S, S, 1]
        errors.append(float(np.asarray(error)[..., 0][counts.numpy()].mean()))
    return errors
