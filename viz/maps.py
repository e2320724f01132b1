"""The scene of maps over the texture: appearance, normals, number of lobes, and BRDFs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..model.relief import Relief
from ..model.spmm import SPMM
from ..report.pictures import heat_colours
from .palette import PAGE, QUIET, Colour, model_colour
from .scene import LegendRow, Part, Picture, Scene, Surface, View, Word
from .slice_picture import slice_codes
from .texel import luminance, model_title

# Least pixels along the longer side of a map; small textures are enlarged to sharp squares.
SHARP = 512
# Half of a map's longer side, and the distance between the middles of neighbouring maps.
HALF, STEP = 0.5, 1.12
# Height of a capital letter, and distance between the rows of a key.
CAPITAL, ROW = 0.042, 0.085
# Rows of a key; if there are more numbers of lobes, only the least and greatest are listed.
MAX_ROWS = 9
# Colours of heights.
HEIGHTS = 256
# Size of the window of so many maps in pixels, and half of the height that it shows.
SIZE, MAPS, HALF_HEIGHT = (1280, 600), 4, 1.07
RIGHT, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class TexelMap:
    """A map over the texels of a texture.

    Attributes:
        title: what it shows.
        codes: `[H, W, 3]`.
        key: the meaning of its colours.
    """

    title: str
    codes: NDArray[np.uint8]
    key: tuple[LegendRow, ...]


def maps_scene(model: SPMM) -> Scene:
    """Maps side by side, seen from above."""
    maps = [
        TexelMap("Texture", slice_codes(model), (LegendRow("seen from above"),)),
        normal_map(model),
        count_map(model),
        model_map(model),
    ]
    if model.relief is not None:
        maps.append(height_map(model, model.relief))
    longest = max(model.height, model.width)
    half = (HALF * model.width / longest, HALF * model.height / longest)
    parts = [
        part
        for number, each in enumerate(maps)
        for part in _panel(each, (number - 0.5 * (len(maps) - 1)) * STEP, half)
    ]
    title = f"{model.name or 'model'}: {model.width} x {model.height} texels"
    focus = np.array([0.0, -0.1, 0.0])
    view = View(focus, np.array([0.0, 0.0, 1.0]), UP, HALF_HEIGHT)
    size = (SIZE[0] * len(maps) // MAPS, SIZE[1])
    return Scene(title, tuple(parts), (), view, size)


@torch.no_grad()
def mean_normals(model: SPMM) -> Tensor:
    """Unit means of the normals of each texel's lobes, weighted by luminance: `[T, 3]`.

    Texels without lobes have the normal of the surface.
    """
    weight = luminance(model.weight)[:, None]
    texel = torch.repeat_interleave(model.lobe_count_per_texel())
    total = weight.new_zeros(model.texel_count, 3)
    total.index_add_(0, texel, weight * model.normal[model.index])
    empty = total.norm(dim=-1) == 0.0
    total[empty] = total.new_tensor([0.0, 0.0, 1.0])
    return total / total.norm(dim=-1, keepdim=True)


def normal_map(model: SPMM) -> TexelMap:
    """Mean normals: red is x, green is y, blue is z, grey is 0."""
    codes = torch.round((0.5 * mean_normals(model) + 0.5) * 255.0).to(torch.uint8)
    key = (
        LegendRow("x, rightwards", (1.0, 0.5, 0.5)),
        LegendRow("y, upwards", (0.5, 1.0, 0.5)),
        LegendRow("z, outwards", (0.5, 0.5, 1.0)),
    )
    return TexelMap("Mean normals", _square(model, codes), key)


def count_map(model: SPMM) -> TexelMap:
    """The number of lobes of each texel."""
    count = model.lobe_count_per_texel().cpu()
    colours = heat_colours(int(count.max()) + 1)
    present = torch.unique(count).tolist()
    shown = present if len(present) <= MAX_ROWS else [present[0], present[-1]]
    key = tuple(LegendRow(str(number), _unit(colours[number])) for number in shown)
    return TexelMap("Lobes of each texel", _square(model, torch.from_numpy(colours)[count]), key)


@torch.no_grad()
def strongest_models(model: SPMM) -> Tensor:
    """The BRDF with the largest luminance of weights in each texel, `[T]`; -1 without lobes."""
    texel = torch.repeat_interleave(model.lobe_count_per_texel())
    kinds = len(MODEL_NAMES)
    place = texel * kinds + model.lobe_model.to(texel.device)[model.index]
    total = luminance(model.weight).new_zeros(model.texel_count * kinds)
    total.index_add_(0, place, luminance(model.weight))
    total = total.view(-1, kinds)
    return torch.where(total.amax(1) > 0.0, total.argmax(1), -1).cpu()


def model_map(model: SPMM) -> TexelMap:
    """The strongest BRDF of each texel."""
    strongest = strongest_models(model)
    colours = [model_colour(index) for index in range(len(MODEL_NAMES))]
    table = torch.tensor([*colours, PAGE]) * 255.0  # -1 picks the page
    present = [index for index in torch.unique(strongest).tolist() if index >= 0]
    key = tuple(LegendRow(model_title(MODEL_NAMES[index]), colours[index]) for index in present)
    codes = torch.round(table).to(torch.uint8)[strongest]
    return TexelMap("Strongest BRDF", _square(model, codes), key)


def height_map(model: SPMM, relief: Relief) -> TexelMap:
    """The height of each texel, from dark to bright."""
    height = relief.heights(model.texel_count).detach().double().cpu()
    low, high = (float(bound) for bound in torch.aminmax(height))
    share = (height - low) / (high - low) if high > low else torch.zeros_like(height)
    colours = heat_colours(HEIGHTS)
    codes = torch.from_numpy(colours)[(share * (HEIGHTS - 1)).round().long()]
    rows = ((high, colours[-1]), (low, colours[0])) if high > low else ((low, colours[0]),)
    key = tuple(
        LegendRow(f"{100.0 * value:.3g} % of the width", _unit(colour)) for value, colour in rows
    )
    return TexelMap("Relief", _square(model, codes), key)


def _square(model: SPMM, codes: Tensor) -> NDArray[np.uint8]:
    return codes.cpu().numpy().reshape(model.height, model.width, 3)


def _unit(codes: NDArray[np.uint8]) -> Colour:
    red, green, blue = (codes / 255.0).tolist()
    return red, green, blue


def _panel(texel_map: TexelMap, x: float, half: tuple[float, float]) -> list[Part]:
    """A map about (x, 0), its title above and its key below."""
    factor = max(1, -(-SHARP // max(texel_map.codes.shape[:2])))
    codes = texel_map.codes.repeat(factor, 0).repeat(factor, 1)
    left = x - half[0]
    title = Word(texel_map.title, _at(left, half[1] + 0.07), CAPITAL * 1.2, RIGHT, UP, align="left")
    parts: list[Part] = [Picture(codes, _at(x, 0.0), half[0] * RIGHT, half[1] * UP), title]
    for number, row in enumerate(texel_map.key):
        y = -half[1] - (number + 1) * ROW
        if row.colour is not None:
            parts.append(_swatch(left, y, row.colour))
        indent = left + (1.9 * CAPITAL if row.colour is not None else 0.0)
        parts.append(Word(row.text, _at(indent, y), CAPITAL, RIGHT, UP, QUIET, align="left"))
    return parts


def _swatch(left: float, y: float, colour: Colour) -> Surface:
    """A small square of a colour, level with the letters of its row."""
    corners = np.array([(0, -0.5), (1, -0.5), (1, 0.5), (0, 0.5)]) * CAPITAL * 1.15
    points = np.pad(corners + (left, y), ((0, 0), (0, 1)))
    return Surface(points, np.array([(0, 1, 2), (0, 2, 3)]), colour, flat=True)


def _at(x: float, y: float) -> NDArray[np.float64]:
    return np.array([x, y, 0.0])
