"""The channels of an OpenEXR file that hold its colour.

Channels are R, G and B, in capitals or not, bare or behind the name of a layer
(`ViewLayer.Combined.R`), in any part of the file; without them X, Y and Z, or Y alone, which are
bare. The bare channels of the first part come first. Of several layers that named `Combined` is
taken, as Blender calls the picture itself; else nobody can tell which one is meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .base import UnsuitableError

RGB, XYZ, GREY = ("R", "G", "B"), ("X", "Y", "Z"), ("Y",)
# What else must not be there: chroma of subsampled colour, or the other axis of a direction.
NOT_BESIDE_GREY = ("RY", "BY", "X")
WHOLE_PICTURE = "combined"


@dataclass(frozen=True)
class Layer:
    """Channels that hold a colour.

    Attributes:
        part: index of the part of the file.
        name: names of part and layer, "" for bare channels of an unnamed part.
        is_bare: whether the channels have no layer.
        channels: their names in the file, three or one.
        is_xyz: whether they are X, Y and Z.
    """

    part: int
    name: str
    is_bare: bool
    channels: tuple[str, ...]
    is_xyz: bool


def find_layer(headers: Sequence[dict[str, Any]]) -> Layer:
    """The channels of the colour, by the headers of all parts.

    Raises:
        ValueError: there are none, or nobody can tell which of several is meant.
    """
    for wanted in (RGB, XYZ, GREY):
        found = [
            layer for part, header in enumerate(headers) for layer in _layers(part, header, wanted)
        ]
        if found:
            return _chosen(found)
    names = sorted(channel.name for header in headers for channel in header["channels"])
    raise UnsuitableError(
        f"its channels are {', '.join(names) or 'none'}; expected R, G and B, or X, Y and Z, or Y "
        f"alone: save its colour under these names"
    )


def _layers(part: int, header: dict[str, Any], wanted: tuple[str, ...]) -> list[Layer]:
    """The layers of a part that have the wanted channels."""
    groups: dict[str, dict[str, str]] = {}
    for name in sorted((channel.name for channel in header["channels"]), reverse=True):
        layer, _, channel = name.rpartition(".")
        groups.setdefault(layer, {})[channel.upper()] = name  # capitals sort last in reverse
    part_name = header.get("name") or ""
    return [
        Layer(
            part=part,
            name=".".join(word for word in (part_name, layer) if word),
            is_bare=not layer,
            channels=tuple(names[channel] for channel in wanted),
            is_xyz=wanted == XYZ,
        )
        for layer, names in groups.items()
        if _holds(names, wanted, is_bare=not layer)
    ]


def _holds(names: dict[str, str], wanted: tuple[str, ...], is_bare: bool) -> bool:
    """Whether a layer holds the wanted channels; X, Y, Z of a named layer are no colour."""
    if wanted == GREY and any(channel in names for channel in NOT_BESIDE_GREY):
        return False
    return (is_bare or wanted == RGB) and all(channel in names for channel in wanted)


def _chosen(layers: Sequence[Layer]) -> Layer:
    """The layer that is the picture itself."""
    first = [layer for layer in layers if layer.is_bare and layer.part == 0]
    whole = [layer for layer in layers if layer.name.lower().split(".")[-1] == WHOLE_PICTURE]
    for candidates in (first, layers, whole):
        if len(candidates) == 1:
            return candidates[0]
    names = ", ".join(sorted(layer.name or "bare channels" for layer in layers))
    raise UnsuitableError(
        f"its layers {names} all hold a colour; expected one: save that layer alone"
    )
