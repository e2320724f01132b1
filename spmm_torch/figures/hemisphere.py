"""Pictures of the upper hemisphere of a texel, projected onto a disk [WDR11 Fig. 10, top]."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image, ImageDraw
from torch import Tensor

from ..geometry.warp import square_to_cosine_hemisphere
from ..model.spmm import SPMM
from ..render.display import Codes, white_exposure

# Colours of intensity 0, of the highest intensity, of dots, and of the rim.
WHITE, BLUE, DOT, RIM = (255, 255, 255), (0, 32, 200), (20, 20, 20), (150, 150, 150)
# Drawn pixels along the side of a shown one.
FINER = 3
DOT_RADIUS = 1.3
# Highlights fall off over decades, which a linear ramp would show as a single dot.
RAMP_GAMMA = 2.2
# Light directions that measure the gloss of a texel.
GLOSS_DIRECTIONS = 1024


@torch.no_grad()
def intensity_picture(model: SPMM, uv: Tensor, wo: Tensor, size: int) -> Codes:
    """Values for all wi in the disk, bluer where they are higher; x to the right, y up.

    Args:
        model: of the texture.
        uv: a point of the texture, `[2]`.
        wo: view direction `[3]`.
        size: pixels along each side.
    """
    axis = (2.0 * (torch.arange(size, device=wo.device) + 0.5) / size - 1.0).to(wo)
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    squared = x * x + y * y
    inside = squared < 1.0
    z = torch.sqrt((1.0 - squared).clamp(min=0.0))
    wi = torch.stack((x, y, z), dim=-1)[inside]  # [N, 3]
    value = model(uv.expand(len(wi), 2), wi, wo.expand_as(wi)).mean(-1).clamp(min=0.0)
    shown = (value * white_exposure(value.cpu().numpy())).clamp(max=1.0) ** (1.0 / RAMP_GAMMA)
    white, blue = (torch.tensor(colour).to(wo) for colour in (WHITE, BLUE))
    picture = white.expand(size, size, 3).clone()
    picture[inside] = white + shown[:, None] * (blue - white)
    return _with_rim(picture.round().to(torch.uint8).cpu().numpy())


def sample_picture(wi: Tensor, size: int) -> Codes:
    """A dot for each of the directions wi `[N, 3]`."""
    fine = FINER * size
    image = Image.new("RGB", (fine, fine), WHITE)
    draw = ImageDraw.Draw(image)
    radius = DOT_RADIUS * FINER
    for x, y, _ in wi.tolist():
        column, row = 0.5 * (1.0 + x) * fine, 0.5 * (1.0 - y) * fine
        box = (column - radius, row - radius, column + radius, row + radius)
        draw.ellipse(box, fill=DOT)
    return _with_rim(np.asarray(image.resize((size, size), Image.Resampling.BOX)))


@torch.no_grad()
def glossiest_texel(model: SPMM, wo: Tensor) -> int:
    """The texel whose value for wo `[3]` varies most over cosine-sampled light directions.

    Sampling by a cosine lobe is noisiest there. The residual does not count.
    """
    points = torch.quasirandom.SobolEngine(2).draw(GLOSS_DIRECTIONS).to(wo)
    wi = square_to_cosine_hemisphere(points)
    rho = model.dictionary.eval_grid(wi, wo[None])  # [J, G]
    estimate = rho / wi[:, 2].clamp(
        min=torch.finfo(wi.dtype).eps
    )  # value over density, times 1 / pi
    weights = model.sparse_weights
    value = F.embedding_bag(
        weights.index,
        estimate,
        weights.offset[:-1],
        mode="sum",
        per_sample_weights=weights.weight.mean(1),
    )  # [T, G]
    return int(value.var(dim=1).argmax())


def texel_centre(model: SPMM, texel: int) -> Tensor:
    """uv `[2]` of the middle of a texel."""
    row, column = divmod(texel, model.width)
    centre = ((column + 0.5) / model.width, 1.0 - (row + 0.5) / model.height)
    return torch.tensor(centre, dtype=model.weight.dtype, device=model.weight.device)


def _with_rim(codes: Codes) -> Codes:
    """A square picture with the circle of the horizon."""
    image = Image.fromarray(codes)
    edge = len(codes) - 1
    ImageDraw.Draw(image).ellipse((0, 0, edge, edge), outline=RIM)
    return np.asarray(image)
