"""What a report opens with: original, model and lobes alone, on a sphere and on a plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from torch import Tensor

from ..render.display import Codes, display_codes
from ..report.pictures import png_uri
from ..report.views import Gallery, Picture, PictureRow
from ..report.wording import decibels, fixed, three_figures
from .display import WHITE, display_psnr
from .flip import flip_map
from .renderings import Renderings

NAMES = ("Original", "Model", "Lobes alone")
# Lights of the sphere that are shown: from the camera, and grazing.
SPHERE_LIGHTS = (0, 2)


def opening_section(spheres: Renderings, planes: Renderings) -> Gallery:
    """A row of three pictures for each shape and light."""
    rows = (
        *_rows("Sphere", spheres, SPHERE_LIGHTS),
        *_rows("Plane", planes, range(len(planes.titles))),
    )
    note = (
        "The material, its model, and the model's lobes without the residual, by direct light. "
        "The plane is seen from 55 degrees off its normal. All pictures of a row share one "
        "exposure, which maps the 99th percentile of the original to white, and the sRGB curve. "
        "PSNR is that of their 8-bit values; FLIP [Andersson et al. 2020] is 0 for pictures that "
        "look the same; both are over the lit pixels."
    )
    return Gallery("Original and model", note, tuple(rows))


def _rows(shape: str, pictures: Renderings, lights: Sequence[int]) -> Iterator[PictureRow]:
    """A row for each of some lights."""
    for light in lights:
        title, exposure = pictures.titles[light], float(pictures.exposure[light])
        counts = pictures.counts[light]
        parts = (pictures.original, pictures.model, pictures.lobes)
        original, *others = (display_codes(part[light], exposure) for part in parts)
        captions = ["", *(f" · {_likeness(original, codes, counts)}" for codes in others)]
        shown = [
            Picture(png_uri(codes), f"{shape}, {title}: {name}", name + caption)
            for name, caption, codes in zip(NAMES, captions, (original, *others), strict=True)
        ]
        heading = f"{shape}, {title[0].lower()}{title[1:]}"
        yield PictureRow(heading, f"exposure × {three_figures(exposure)}", tuple(shown))


def _likeness(original: Codes, codes: Codes, counts: Tensor) -> str:
    """`PSNR 31.20 dB, FLIP 0.051` over the pixels that count; without FLIP where it is missing."""
    text = f"PSNR {decibels(display_psnr(original, codes, counts))}"
    error = flip_map(original / WHITE, codes / WHITE)
    if error is None:
        return text
    return f"{text}, FLIP {fixed(float(error[counts.numpy()].mean()), 3)}"
