"""The texture slices: original, lobes, model and difference at a few direction pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..data.options import DISPLAY_GAMMA
from ..metrics import snr_db
from ..model.spmm import SPMM
from ..render.display import display_codes, white_exposure
from .markup import Markup, figure, join, picture, tag
from .pairs import Pair, angles, choose_pairs
from .pictures import png_uri, shared_gain
from .wording import decibels, three_figures

# Pictures are shown about this many pixels wide: larger ones look better smoothed.
SHOWN_WIDTH = 220


@dataclass(frozen=True)
class Slice:
    """One direction pair: linear pictures `[H, W, 3]`, and the factor they are shown with."""

    title: str
    directions: str
    original: Tensor
    lobes: Tensor
    model: Tensor
    factor: float


def slices_section(
    model: SPMM, btf: BTF, pairs: Sequence[Pair] | None = None, title: str = "Texture slices"
) -> Markup:
    """Rows of pictures, one for each pair; of the pairs that show most by default."""
    if pairs is None:
        pairs = choose_pairs(btf.light, btf.view, btf.missing)
    slices = take_slices(model, btf, pairs)
    gain = shared_gain([part.factor * (part.original - part.model) for part in slices])
    note = (
        "Values are linear and cosine-weighted, shown with gamma 2.2. In each row all pictures "
        "share one exposure, which maps the 99th percentile of the original to white. The "
        f"difference is |original − model| times {gain}, residual included, under the same "
        "exposure and gamma. SNR is that of the pair alone. Angles are polar / azimuth, azimuth "
        "counter-clockwise from the right."
    )
    rows = [_row(part, gain) for part in slices]
    return join((tag("h2", title), tag("p", note, class_="quiet"), *rows))


@torch.no_grad()
def take_slices(model: SPMM, btf: BTF, pairs: Sequence[Pair]) -> list[Slice]:
    """Some pairs of the BTF and of its model."""
    slices = []
    for pair in pairs:
        wi, wo = btf.light[pair.light], btf.view[pair.view]
        original = btf.picture(pair.view, pair.light).cpu().float()
        lobes, whole = (
            model.picture(wi.to(model.light), wo.to(model.view), residual=residual).cpu().float()
            for residual in (False, True)
        )
        directions = f"light {angles(wi)}, view {angles(wo)}"
        factor = white_exposure(original.numpy())
        slices.append(Slice(pair.title, directions, original, lobes, whole, factor))
    return slices


def slice_snr(original: Tensor, approximation: Tensor) -> float | None:
    """SNR in decibels of one slice; None where the original is black."""
    energy = float(original.double().square().sum())
    error = float((original - approximation).double().square().sum())
    return snr_db(energy, error) if energy > 0.0 else None


def _snr_note(original: Tensor, approximation: Tensor) -> str:
    return f" · SNR {decibels(slice_snr(original, approximation))}"


def _row(part: Slice, gain: int) -> Markup:
    difference = (part.original - part.model).abs()
    shown: Sequence[tuple[str, Tensor, float, str]] = (
        ("Original", part.original, 1.0, ""),
        ("Lobes", part.lobes, 1.0, _snr_note(part.original, part.lobes)),
        ("Lobes + residual", part.model, 1.0, _snr_note(part.original, part.model)),
        (f"Difference × {gain}", difference, float(gain), ""),
    )
    pixelated = part.original.shape[1] < SHOWN_WIDTH
    figures = []
    for name, linear, factor, note in shown:
        uri = png_uri(display_codes(linear, factor * part.factor, DISPLAY_GAMMA))
        image = picture(uri, f"{part.title}: {name}", pixelated=pixelated)
        figures.append(figure(image, name, note))
    where = f" · {part.directions} · exposure × {three_figures(part.factor)}"
    heading = tag("h3", part.title, tag("span", where, class_="quiet"))
    return tag("div", heading, tag("div", *figures, class_="slices"), class_="panel")
