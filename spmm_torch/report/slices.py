"""The texture slices: original, lobes, model and difference at a few direction pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..data import BTF
from ..metrics import snr_db
from ..model import SPMM
from .markup import Markup, figure, join, picture, tag
from .pairs import angles, choose_pairs
from .pictures import SHOWN_FRACTION, Linear, difference_gain, display, exposure, png_uri
from .wording import decibels, three_figures

# Pictures are shown about this many pixels wide: larger ones look better smoothed.
SHOWN_WIDTH = 220


@dataclass(frozen=True)
class Slice:
    """One direction pair: linear pictures `[H, W, 3]`, and the factor they are shown with."""

    title: str
    directions: str
    original: Linear
    lobes: Linear
    model: Linear
    factor: float


def slices_section(model: SPMM, btf: BTF) -> Markup:
    """Rows of pictures, one for each chosen pair."""
    slices = take_slices(model, btf)
    worst = max(
        float(np.quantile(np.abs(part.original - part.model), SHOWN_FRACTION)) * part.factor
        for part in slices
    )
    gain = difference_gain(worst)
    note = (
        "Values are linear and cosine-weighted, shown with gamma 2.2. In each row all pictures "
        "share one exposure, which maps the 99th percentile of the original to white. The "
        f"difference is |original − model| times {gain}, residual included, under the same "
        "exposure and gamma. SNR is that of the pair alone. Angles are polar / azimuth, azimuth "
        "counter-clockwise from the right."
    )
    rows = [_row(part, gain) for part in slices]
    return join((tag("h2", "Texture slices"), tag("p", note, class_="quiet"), *rows))


@torch.no_grad()
def take_slices(model: SPMM, btf: BTF) -> list[Slice]:
    """The chosen pairs of the BTF and of its model."""
    slices = []
    for pair in choose_pairs(btf.light, btf.view):
        wi, wo = model.light[pair.light], model.view[pair.view]
        original = btf.picture(pair.view, pair.light).cpu().float().numpy()
        lobes, whole = (
            model.picture(wi, wo, residual=residual).cpu().float().numpy()
            for residual in (False, True)
        )
        directions = f"light {angles(wi)}, view {angles(wo)}"
        slices.append(Slice(pair.title, directions, original, lobes, whole, exposure(original)))
    return slices


def slice_snr(original: Linear, approximation: Linear) -> float | None:
    """SNR in decibels of one slice; None where the original is black."""
    energy = float(np.square(original, dtype=np.float64).sum())
    error = float(np.square(original - approximation, dtype=np.float64).sum())
    return snr_db(energy, error) if energy > 0.0 else None


def _snr_note(original: Linear, approximation: Linear) -> str:
    return f" · SNR {decibels(slice_snr(original, approximation))}"


def _row(part: Slice, gain: int) -> Markup:
    difference = np.abs(part.original - part.model)
    shown: Sequence[tuple[str, Linear, float, str]] = (
        ("Original", part.original, 1.0, ""),
        ("Lobes", part.lobes, 1.0, _snr_note(part.original, part.lobes)),
        ("Lobes + residual", part.model, 1.0, _snr_note(part.original, part.model)),
        (f"Difference × {gain}", difference, float(gain), ""),
    )
    pixelated = part.original.shape[1] < SHOWN_WIDTH
    figures = []
    for name, linear, factor, note in shown:
        uri = png_uri(display(linear, factor * part.factor))
        image = picture(uri, f"{part.title}: {name}", pixelated=pixelated)
        figures.append(figure(image, name, note))
    where = f" · {part.directions} · exposure × {three_figures(part.factor)}"
    heading = tag("h3", part.title, tag("span", where, class_="quiet"))
    return tag("div", heading, tag("div", *figures, class_="slices"), class_="panel")
