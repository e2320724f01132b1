"""FLIP: the visible difference of two pictures that alternate."""

from __future__ import annotations

import numpy as np

from .spheres import Spheres


def flip(spheres: Spheres) -> list[float] | None:
    """The mean FLIP error of each pair of sphere pictures; None without the extra `eval`.

    Pictures that look the same have error 0. They are tone-mapped as for MSSIM; the mean is over
    the pixels that count. The viewing distance is the default, 67 pixels a degree [Andersson et
    al. 2020, FLIP: A Difference Evaluator for Alternating Images].
    """
    try:
        from flip_evaluator import evaluate
    except ImportError:
        return None
    errors = []
    for original, model, counts in zip(*spheres.shown(), spheres.counts, strict=True):
        reference, test = (np.ascontiguousarray(x.float().numpy()) for x in (original, model))
        error, _, _ = evaluate(
            reference, test, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False
        )  # [S, S, 1]
        errors.append(float(np.asarray(error)[..., 0][counts.numpy()].mean()))
    return errors
