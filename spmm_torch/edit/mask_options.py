"""Masks as they stand in a script: one dataclass a kind, and their combinations.

A mask is a mapping of one key, such as `{rectangle: {x: 0, y: 0, width: 8, height: 4}}`;
`{all: [...]}`, `{any: [...]}` and `{not: ...}` combine masks. Angles are degrees.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import reduce
from typing import Any, Protocol

import torch
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..config.schema import REQUIRED, from_dict, plain, setting
from ..errors import ConfigError
from ..geometry.directions import direction_from_angles
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM
from .masks import cluster_selection, colour_selection, lobe_selection, picture_selection
from .regions import Rectangle, Stripes
from .selection import Selection, select_texels


class Mask(Protocol):
    """A place in a texture, or a kind of lobes, whatever the model."""

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        ...


@dataclass(frozen=True)
class RectangleMask:
    """A rectangle of texels."""

    x: int = setting(REQUIRED, "the leftmost column", low=0)
    y: int = setting(REQUIRED, "the topmost row", low=0)
    width: int = setting(REQUIRED, "number of columns", low=1)
    height: int = setting(REQUIRED, "number of rows", low=1)

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        return select_texels(model, Rectangle(self.x, self.y, self.width, self.height).mask(model))


@dataclass(frozen=True)
class StripesMask:
    """Even stripes over the whole texture."""

    count: int = setting(4, "stripes across the texture", low=1)
    share: float = setting(0.5, "part of the period that a stripe covers", low=0.0, high=1.0)
    soft: float = setting(0.0, "part of the period over which an edge fades", low=0.0, high=1.0)
    shift: float = setting(0.5, "middle of the first stripe, in periods", low=0.0, high=1.0)
    vertical: bool = setting(True, "whether stripes run up and down")

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        stripes = Stripes(self.count, self.share, self.soft, self.shift, self.vertical)
        return select_texels(model, stripes.mask(model))


@dataclass(frozen=True)
class PictureMask:
    """A grey picture of the size of the texture."""

    path: str = setting(REQUIRED, "a picture, white where the edit acts; relative to the script")

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        return picture_selection(model, self.path)


@dataclass(frozen=True)
class ClusterMask:
    """Clusters of texels."""

    number: tuple[int, ...] = setting(REQUIRED, "one number of a cluster, or a list", low=0)

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        return cluster_selection(model, self.number)


@dataclass(frozen=True)
class ColourMask:
    """A range of colours in one slice of the texture."""

    low: tuple[float, ...] = setting(REQUIRED, "the lowest linear RGB")
    high: tuple[float, ...] = setting(REQUIRED, "the highest linear RGB")
    soft: float = setting(0.0, "how far outside of the range shares fade to 0", low=0.0)
    light: tuple[float, ...] = setting((0.0, 0.0), "theta, phi of the light in degrees")
    view: tuple[float, ...] = setting((0.0, 0.0), "theta, phi of the view in degrees")

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        wi, wo = (_direction(name, getattr(self, name)) for name in ("light", "view"))
        return colour_selection(model, wi, wo, self.low, self.high, self.soft)


@dataclass(frozen=True)
class LobesMask:
    """Lobes that have all of the properties that are given."""

    models: tuple[str, ...] | None = setting(None, "names of BRDFs", choices=MODEL_NAMES)
    specular: bool | None = setting(None, "whether of the specular group")
    width: tuple[float, ...] | None = setting(None, "from, to; slope of half vector, rad", low=0.0)
    elevation: tuple[float, ...] | None = setting(
        None, "from, to; degrees of the normal above the horizon", low=0.0, high=90.0
    )
    threshold: float = setting(SPECULAR_WIDTH, "width under which lobes are specular", low=0.0)

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        width, elevation = (_span(name, getattr(self, name)) for name in ("width", "elevation"))
        if elevation is not None:
            elevation = (math.radians(elevation[0]), math.radians(elevation[1]))
        return lobe_selection(model, self.models, self.specular, width, elevation, self.threshold)


@dataclass(frozen=True)
class Combined:
    """Several masks in one.

    Attributes:
        kind: `all`, `any` or `not`.
        masks: just one for `not`.
    """

    kind: str
    masks: tuple[Mask, ...]

    def select(self, model: SPMM) -> Selection:
        """What it means in a model."""
        return COMBINATIONS[self.kind]([mask.select(model) for mask in self.masks])


COMBINATIONS: dict[str, Callable[[list[Selection]], Selection]] = {
    "all": lambda parts: reduce(lambda a, b: a & b, parts),
    "any": lambda parts: reduce(lambda a, b: a | b, parts),
    "not": lambda parts: ~parts[0],
}
MASKS: dict[str, type] = {
    "rectangle": RectangleMask,
    "stripes": StripesMask,
    "picture": PictureMask,
    "cluster": ClusterMask,
    "colour": ColourMask,
    "lobes": LobesMask,
}


def parse_mask(value: Any, where: str) -> Mask:
    """The mask of plain values; `where` names its place in messages.

    Raises:
        ConfigError: unknown kind or option, wrong type, or out of range.
    """
    known = (*MASKS, *COMBINATIONS)
    if not isinstance(value, dict) or len(value) != 1:
        raise ConfigError(
            f"{where} is {value!r}; expected one kind of mask with its options, such as "
            f"{{cluster: {{number: 3}}}}; kinds: {', '.join(known)}."
        )
    ((kind, options),) = value.items()
    if kind in MASKS:
        return from_dict(MASKS[kind], options, f"{where}.{kind}.")
    if kind == "not":
        return Combined("not", (parse_mask(options, f"{where}.not"),))
    if kind in COMBINATIONS:
        if not isinstance(options, list) or not options:
            raise ConfigError(f"{where}.{kind} is {options!r}; expected a list of masks.")
        parts = [parse_mask(part, f"{where}.{kind}[{i}]") for i, part in enumerate(options)]
        return Combined(kind, tuple(parts))
    raise ConfigError(f"unknown mask {where}.{kind}; {nearest(str(kind), known)}")


def plain_mask(mask: Mask) -> dict[str, Any]:
    """Plain values that `parse_mask` takes back."""
    if isinstance(mask, Combined):
        parts = [plain_mask(part) for part in mask.masks]
        return {mask.kind: parts[0] if mask.kind == "not" else parts}
    name = next(name for name, kind in MASKS.items() if type(mask) is kind)
    return {name: given(mask)}


def given(options: Any) -> dict[str, Any]:
    """The options of a dataclass that differ from their defaults, as plain values."""
    values = {item.name: (getattr(options, item.name), item.default) for item in fields(options)}
    return {name: plain(value) for name, (value, default) in values.items() if value != default}


def nearest(name: str, known: tuple[str, ...]) -> str:
    """What to write in place of an unknown name."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"valid: {', '.join(known)}."


def _direction(name: str, angles: tuple[float, ...]) -> Tensor:
    if len(angles) != 2 or not 0.0 <= angles[0] < 90.0:
        raise ConfigError(
            f"the {name} of a colour mask is {list(angles)}; expected theta and phi in degrees, "
            f"theta from 0 to below 90."
        )
    theta, phi = torch.deg2rad(torch.tensor(angles)).unbind()
    return direction_from_angles(theta, phi)


def _span(name: str, limits: tuple[float, ...] | None) -> tuple[float, float] | None:
    if limits is None:
        return None
    if len(limits) != 2 or limits[0] > limits[1]:
        raise ConfigError(f"{name} is {list(limits)}; expected two numbers, the lower one first.")
    return limits[0], limits[1]
