"""The relief of a model: its map, and what it changes under an oblique view."""

from __future__ import annotations

import torch
from torch import Tensor

from ..data import BTF
from ..data.options import DISPLAY_GAMMA
from ..edit.parts import flattened
from ..model.relief import Relief
from ..model.spmm import SPMM
from ..render.display import display_codes, white_exposure
from .pairs import choose_pairs, directions_text
from .pictures import heat_colours
from .slices import slice_snr
from .views import Gallery, Picture, PictureRow
from .wording import decibels

STEPS = 256
# Title, then (polar angle, azimuth) of light and view in degrees: see `pairs.WANTED`.
OBLIQUE = (("View at 60°", (45.0, 90.0), (60.0, 0.0)),)


def height_map(model: SPMM, relief: Relief) -> Picture:
    """The height of each texel, by colour."""
    height = relief.heights(model.texel_count).detach().double().cpu()
    low, high = (float(bound) for bound in torch.aminmax(height))
    index = torch.zeros_like(height, dtype=torch.long)
    caption = f"A plane, {_percent(low)} over that of the pictures."
    if high > low:
        index = ((height - low) / (high - low) * (STEPS - 1)).round().long()
        caption = (
            f"From {_percent(low)} (dark) to {_percent(high)} (bright) of the texture's width over "
            f"the plane of the pictures, {_percent(float(height.mean()))} on average."
        )
    codes = heat_colours(STEPS)[index.numpy()].reshape(model.height, model.width, 3)
    return Picture.of_texels(codes, "Height map", caption)


@torch.no_grad()
def relief_gallery(model: SPMM, btf: BTF) -> Gallery | None:
    """The original under a view at 60 degrees beside the model, with and without its relief.

    None where the model has no relief.
    """
    if model.relief is None:
        return None
    pair = choose_pairs(btf.light, btf.view, btf.missing, OBLIQUE)[0]
    wi, wo = btf.light[pair.light].to(model.light), btf.view[pair.view].to(model.view)
    flat = flattened(model)
    original = btf.picture(pair.view, pair.light).cpu().float()
    shown = {"Original": original}
    for name, each in (("With relief", model), ("Without relief", flat)):
        shown[name] = each.picture(wi, wo, registered=True).cpu().float()
    factor = white_exposure(original.numpy())

    def picture(name: str, linear: Tensor) -> Picture:
        codes = display_codes(linear, factor, DISPLAY_GAMMA)
        snr = "" if name == "Original" else f" · SNR {decibels(slice_snr(original, linear))}"
        return Picture.of_texels(codes, f"{pair.title}: {name}", name + snr)

    note = (
        "An oblique view shows each point of the surface shifted by its height. Without the relief "
        "the same lobes lie in the plane of the pictures. Exposure and gamma as above."
    )
    pictures = tuple(picture(name, linear) for name, linear in shown.items())
    return Gallery("Relief", note, (PictureRow(pair.title, directions_text(wi, wo), pictures),))


def _percent(height: float) -> str:
    """A height in texture widths: `2.5 %`."""
    return f"{100.0 * height:.3g} %"
