"""The sphere pictures on a page: original, model and difference, light by light."""

from __future__ import annotations

from ..render import display_codes
from ..report.markup import Markup, figure, join, picture, tag
from ..report.pictures import png_uri, shared_gain
from .judge import Likeness
from .mssim import Score
from .spheres import TEXELS_IN_HALF_TURN

NOTE = (
    "A sphere seen from the front under one directional light each; "
    f"{TEXELS_IN_HALF_TURN} texels lie along half a turn. Both pictures of a row share one "
    "exposure, which maps the 99th percentile of the original to white, and the sRGB curve. MSSIM "
    "is the mean structural similarity of Y, Cr and Cb over the lit side, 1 for equal pictures. "
    "The difference is |original − model| times "
)


def sphere_section(found: Likeness) -> Markup:
    """A row of pictures for each light."""
    spheres = found.spheres
    pairs = list(zip(spheres.original, spheres.model, spheres.exposure.tolist(), strict=True))
    gain = shared_gain([factor * (original - model) for original, model, factor in pairs])
    rows = []
    for title, score, (original, model, factor) in zip(
        spheres.titles, found.scores, pairs, strict=True
    ):
        shown = (
            ("Original", original, factor),
            (f"Model · MSSIM {score['mean']:.3f}", model, factor),
            (f"Difference × {gain}", (original - model).abs(), gain * factor),
        )
        figures = []
        for caption, linear, exposure in shown:
            uri = png_uri(display_codes(linear, exposure))
            alternative = f"Sphere, {title}: {caption.partition(' ·')[0]}"
            figures.append(figure(picture(uri, alternative, pixelated=False), caption))
        heading = tag("h3", title, tag("span", f" · {channel_scores(score)}", class_="quiet"))
        rows.append(tag("div", heading, tag("div", *figures, class_="slices"), class_="panel"))
    note = tag("p", f"{NOTE}{gain}.", class_="quiet")
    return join((tag("h2", "Spheres"), note, *rows))


def channel_scores(score: Score) -> str:
    """`Y 0.912, Cr 0.981, Cb 0.977`."""
    return ", ".join(f"{name.capitalize()} {score[name]:.3f}" for name in ("y", "cr", "cb"))
