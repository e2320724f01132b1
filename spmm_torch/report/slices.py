"""Texture slices: original, lobes, model and difference at a few direction pairs."""

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
from .pairs import Pair, choose_pairs, directions_text
from .pictures import shared_gain
from .views import Gallery, Picture, PictureRow
from .wording import decibels, three_figures


@dataclass(frozen=True)
class Slice:
    """One direction pair.

    Attributes:
        title: of the pair.
        directions: its angles, as text.
        original, lobes, model: linear pictures `[H, W, 3]`.
        factor: the exposure of all three.
    """

    title: str
    directions: str
    original: Tensor
    lobes: Tensor
    model: Tensor
    factor: float


def slice_gallery(
    model: SPMM, btf: BTF, pairs: Sequence[Pair] | None = None, title: str = "Texture slices"
) -> Gallery:
    """A row of pictures for each pair; by default for the pairs of `choose_pairs`."""
    if pairs is None:
        pairs = choose_pairs(btf.light, btf.view, btf.missing)
    slices = take_slices(model, btf, pairs)
    gain = shared_gain([part.factor * (part.original - part.model) for part in slices])
    note = (
        "Values are linear and cosine-weighted, shown with gamma 2.2. All pictures of a row share "
        "one exposure, which maps the 99th percentile of the original to white. The difference is "
        f"|original − model| times {gain}, residual included, under the same exposure and gamma. "
        "SNR is that of the pair alone. Angles are polar / azimuth; the azimuth is "
        "counter-clockwise from the right."
    )
    return Gallery(title, note, tuple(_row(part, gain) for part in slices))


@torch.no_grad()
def take_slices(model: SPMM, btf: BTF, pairs: Sequence[Pair]) -> list[Slice]:
    """Pictures of the BTF and of its model at some direction pairs."""
    slices = []
    for pair in pairs:
        wi, wo = btf.light[pair.light], btf.view[pair.view]
        original = btf.picture(pair.view, pair.light).cpu().float()
        wi, wo = wi.to(model.light), wo.to(model.view)
        lobes, whole = (
            model.picture(wi, wo, residual, registered=True).cpu().float()
            for residual in (False, True)
        )
        factor = white_exposure(original.numpy())
        directions = directions_text(wi, wo)
        slices.append(Slice(pair.title, directions, original, lobes, whole, factor))
    return slices


def slice_snr(original: Tensor, approximation: Tensor) -> float | None:
    """SNR in decibels of one slice `[H, W, 3]`; None where the original is black."""
    energy = float(original.double().square().sum())
    error = float((original - approximation).double().square().sum())
    return snr_db(energy, error) if energy > 0.0 else None


def _row(part: Slice, gain: int) -> PictureRow:
    def picture(name: str, linear: Tensor, factor: float = 1.0, note: str = "") -> Picture:
        codes = display_codes(linear, factor * part.factor, DISPLAY_GAMMA)
        return Picture.of_texels(codes, f"{part.title}: {name}", name + note)

    def snr(approximation: Tensor) -> str:
        return f" · SNR {decibels(slice_snr(part.original, approximation))}"

    difference = (part.original - part.model).abs()
    pictures = (
        picture("Original", part.original),
        picture("Lobes", part.lobes, note=snr(part.lobes)),
        picture("Lobes + residual", part.model, note=snr(part.model)),
        picture(f"Difference × {gain}", difference, float(gain)),
    )
    note = f"{part.directions} · exposure × {three_figures(part.factor)}"
    return PictureRow(part.title, note, pictures)
