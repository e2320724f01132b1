"""The sphere pictures on a page: original, model and difference, light by light."""

from __future__ import annotations

from torch import Tensor

from ..render import display_codes
from ..report.pictures import png_uri, shared_gain
from ..report.views import Gallery, Picture, PictureRow
from .judge import Likeness
from .mssim import Score
from .spheres import TEXELS_IN_HALF_TURN


def sphere_section(found: Likeness) -> Gallery:
    """A row of pictures for each light."""
    spheres = found.spheres
    pairs = list(zip(spheres.original, spheres.model, spheres.exposure.tolist(), strict=True))
    gain = shared_gain([factor * (original - model) for original, model, factor in pairs])
    rows = (
        _row(title, score, *pair, gain)
        for title, score, pair in zip(spheres.titles, found.scores, pairs, strict=True)
    )
    note = (
        "A sphere seen from the front, under one directional light a row; "
        f"{TEXELS_IN_HALF_TURN} texels lie along half a turn. All pictures of a row share one "
        "exposure, which maps the 99th percentile of the original to white, and the sRGB curve. "
        "MSSIM is the mean structural similarity of Y, Cr and Cb over the lit side, 1 for equal "
        f"pictures. The difference is |original − model| times {gain}."
    )
    return Gallery("Spheres", note, tuple(rows))


def _channel_scores(score: Score) -> str:
    """`Y 0.912, Cr 0.981, Cb 0.977`."""
    return ", ".join(f"{name.capitalize()} {score[name]:.3f}" for name in ("y", "cr", "cb"))


def _row(
    title: str, score: Score, original: Tensor, model: Tensor, exposure: float, gain: int
) -> PictureRow:
    """A row of linear pictures `[S, S, 3]` and their difference."""

    def picture(name: str, linear: Tensor, factor: float, note: str = "") -> Picture:
        uri = png_uri(display_codes(linear, factor))
        return Picture(uri, f"Sphere, {title}: {name}", name + note)

    pictures = (
        picture("Original", original, exposure),
        picture("Model", model, exposure, f" · MSSIM {score['mean']:.3f}"),
        picture(f"Difference × {gain}", (original - model).abs(), gain * exposure),
    )
    return PictureRow(title, _channel_scores(score), pictures)
