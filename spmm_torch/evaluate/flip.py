"""FLIP: the visible difference of two pictures that alternate."""

from __future__ import annotations

import numpy as np

from .renderings import Renderings


def flip(pictures: Renderings) -> list[float] | None:
    """The mean FLIP error of each pair of rendered pictures; None without the extra `eval`.

    Pictures that look the same have error 0. They are tone-mapped as for MSSIM; the mean is over
    the pixels that count.
    """
    errors = []
    for original, model, counts in zip(*pictures.shown(), pictures.counts, strict=True):
        error = flip_map(original.float().numpy(), model.float().numpy())
        if error is None:
            return None
        errors.append(float(error[counts.numpy()].mean()))
    return errors


def flip_map(reference: np.ndarray, test: np.ndarray) -> np.ndarray | None:
    """The FLIP error `[H, W]` of display values `[H, W, 3]` in 0..1, by the sRGB curve.

    None without the extra `eval`. The viewing distance is the default, 67 pixels a degree
    [Andersson et al. 2020, FLIP: A Difference Evaluator for Alternating Images].
    """
    try:
        from flip_evaluator import evaluate
    except ImportError:
        return None
    first, second = (np.ascontiguousarray(part, dtype=np.float32) for part in (reference, test))
    error, _, _ = evaluate(
        first, second, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=False
    )  # [H, W, 1]
    return np.asarray(error)[..., 0]
