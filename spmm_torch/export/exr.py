"""All numbers of a model as planes of one multi-part OpenEXR file; see docs/exports.md.

All channels are single floats, which every reader of OpenEXR knows; indices are exact below 2^24.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import torch
from torch import Tensor

from ..errors import OutputError
from ..model.residual import decode_residual
from ..model.spmm import SPMM
from ..runtime.progress import Progress
from .target import Exported, NoSettings

FORMAT, VERSION = "spmm_torch planes", "1"
PREFIX = "spmm_torch:"
RGB, XYZ, UV = ("R", "G", "B"), ("X", "Y", "Z"), ("U", "V")
# Singles hold all whole numbers up to this.
MAX_INDEX = 1 << 24
# The channels `[rows, columns]` of each part, by name.
Planes = dict[str, dict[str, np.ndarray]]


def write(place: Path, model: SPMM, settings: NoSettings, progress: Progress) -> Exported:
    """Writes all planes, and reads them back; see `Target.write`.

    Raises:
        OutputError: more lobes or clusters than a float counts.
    """
    if max(len(model.dictionary), model.cluster_count) > MAX_INDEX:
        raise OutputError(
            f"the model has {len(model.dictionary):,} lobes; expected at most {MAX_INDEX:,} for "
            f"--to exr; choose another target."
        )
    planes = planes_of(model)
    with progress.stage("write", len(planes), "parts"):
        write_parts(place, planes, attributes_of(model))
    return Exported(model_of_planes(*read_parts(place)).to(model.weight.device))


@torch.no_grad()
def planes_of(model: SPMM) -> Planes:
    """The channels `[rows, columns]` of each part by name, all float32."""
    parts = {
        "texels": _texels(model),
        **_slots(model),
        "dictionary": _dictionary(model),
        "light": _channels(model.light[None], XYZ),
        "view": _channels(model.view[None], XYZ),
    }
    if model.relief is not None and model.relief.drift is not None:
        parts["view"] |= _channels(model.relief.drift[None], UV, "drift.")
    code, scale = model.residual.code, model.residual.scale
    clusters = decode_residual(code, scale)  # [K, V, L, 3]
    parts |= {f"residual.{k}": _channels(values, RGB) for k, values in enumerate(clusters)}
    if (components := model.components) is not None:
        functions = components.code.float() * components.scale[:, :, None, None]  # [R, V, L, 3]
        parts |= {f"component.{r}": _channels(part, RGB) for r, part in enumerate(functions)}
    return {name: _arrays(channels) for name, channels in parts.items()}


def _texels(model: SPMM) -> dict[str, Tensor]:
    """What each texel has one of: counts, clusters, coefficients of components, heights."""
    size = model.height, model.width
    planes = {"count": model.lobe_count_per_texel(), "cluster": model.labels}
    if model.components is not None:
        columns = model.components.coefficients().unbind(1)
        planes |= {f"coefficient.{r}": column for r, column in enumerate(columns)}
    if model.relief is not None:
        planes["height"] = model.relief.heights(model.texel_count)
    return {name: plane.view(size) for name, plane in planes.items()}


def _dictionary(model: SPMM) -> dict[str, Tensor]:
    """A column for each lobe."""
    tensors, _ = model.to_tensors()
    kappa = tensors["dictionary.kappa"].unbind(1)
    return {
        "model": tensors["dictionary.model"][None],
        **{f"kappa.{n}": column[None] for n, column in enumerate(kappa)},
        **_channels(tensors["dictionary.normal"][None], XYZ, "normal."),
        "angle": tensors["dictionary.angle"][None],
    }


def _slots(model: SPMM) -> dict[str, dict[str, Tensor]]:
    """A part for the first lobe of all texels, one for the second, and so on."""
    size = model.height, model.width
    count = model.lobe_count_per_texel()
    parts = {}
    for slot in range(int(count.max())):
        has = count > slot
        entry = torch.where(has, model.offset[:-1] + slot, 0)
        weight = model.weight[entry] * has[:, None]
        lobe = model.index[entry] * has
        parts[f"slot.{slot}"] = {
            "lobe": lobe.view(size),
            **_channels(weight.view(*size, 3), RGB),
        }
    return parts


def _channels(values: Tensor, names: tuple[str, ...], prefix: str = "") -> dict[str, Tensor]:
    """A channel `[rows, columns]` for each of the last dimension of values `[rows, columns, N]`."""
    return {prefix + name: plane for name, plane in zip(names, values.unbind(-1), strict=True)}


def _arrays(channels: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
    """Contiguous float32 arrays: the library writes strided ones wrongly, without an error."""
    return {
        name: np.ascontiguousarray(plane.detach().cpu().float().numpy())
        for name, plane in channels.items()
    }


def attributes_of(model: SPMM) -> dict[str, str]:
    """What is no plane: the metadata of the model file, with the format of this one."""
    _, metadata = model.to_tensors()
    return metadata | {"format": FORMAT, "version": VERSION}


def write_parts(place: Path, planes: Planes, attributes: Mapping[str, str]) -> None:
    """Writes all parts; the first one has the attributes, each with a prefix."""
    shape = next(iter(planes["texels"].values())).shape
    named: dict[str, Any] = {PREFIX + name: text for name, text in attributes.items()}
    parts = []
    for name, channels in planes.items():
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "displayWindow": _window(shape),  # the format wants the same one in all parts
            "dataWindow": _window(next(iter(channels.values())).shape),
            **named,
        }
        parts.append(OpenEXR.Part(header, channels, name))
        named = {}
    with place.open("wb") as file:  # the library takes no path of any bytes
        OpenEXR.File(parts).write(file)


def _window(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The window of a picture of (rows, columns)."""
    rows, columns = shape
    return np.zeros(2, np.int32), np.array([columns - 1, rows - 1], np.int32)


def read_parts(path: Path) -> tuple[Planes, dict[str, str]]:
    """The planes and attributes of a file that `write_parts` has written."""
    parts = OpenEXR.File(io.BytesIO(path.read_bytes()), separate_channels=True).parts
    planes = {
        part.name(): {name: np.asarray(each.pixels) for name, each in part.channels.items()}
        for part in parts
    }
    header = parts[0].header
    named = {name.removeprefix(PREFIX): header[name] for name in header if PREFIX in name}
    return planes, named


def model_of_planes(planes: Planes, attributes: Mapping[str, str]) -> SPMM:
    """The model of planes and attributes, whose values are those of the one written."""
    parts = {
        name: {channel: torch.from_numpy(plane) for channel, plane in channels.items()}
        for name, channels in planes.items()
    }
    light, view = (_vectors(parts[name], XYZ) for name in ("light", "view"))
    pairs = (len(view), len(light), len(RGB))
    clusters = _all(parts, "residual")
    tensors = {
        **_entries(parts),
        "weights.label": parts["texels"]["cluster"].flatten(),
        "dictionary.model": parts["dictionary"]["model"][0].long(),
        "dictionary.kappa": torch.stack(_all(parts["dictionary"], "kappa"), dim=-1)[0],
        "dictionary.normal": _vectors(parts["dictionary"], XYZ, "normal."),
        "dictionary.angle": parts["dictionary"]["angle"][0],
        "residual.code": _stacked(clusters) if clusters else torch.zeros(0, *pairs),
        "residual.scale": torch.ones(len(clusters)),
        "directions.light": light,
        "directions.view": view,
    }
    if functions := _all(parts, "component"):
        coefficient = torch.stack(_all(parts["texels"], "coefficient"), dim=-1)  # [H, W, R]
        tensors["components.code"] = _stacked(functions)
        tensors["components.scale"] = torch.ones(len(functions), len(view))
        tensors["components.coefficient"] = coefficient.flatten(0, 1)
        tensors["components.coefficient_scale"] = torch.ones(len(functions))
    if "height" in parts["texels"]:
        tensors["relief.offset"] = torch.zeros(1)
        tensors["relief.scale"] = torch.ones(1)
        tensors["relief.code"] = parts["texels"]["height"].flatten()
    return SPMM.from_tensors(tensors, dict(attributes))


def _entries(parts: Mapping[str, Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """The entries of all texels, texel after texel."""
    count = parts["texels"]["count"].flatten().long()
    slots = _all(parts, "slot")
    if not slots:
        return {
            "weights.count": count,
            "weights.index": count[:0],
            "weights.weight": torch.zeros(0, 3),
        }
    has = torch.arange(len(slots)) < count[:, None]  # [T, M]
    lobe = torch.stack([slot["lobe"].flatten() for slot in slots], dim=1)
    weight = torch.stack([_vectors(slot, RGB) for slot in slots], dim=1)
    return {
        "weights.count": count,
        "weights.index": lobe[has].long(),
        "weights.weight": weight[has],
    }


def _all(named: Mapping[str, Any], prefix: str) -> list[Any]:
    """What is called `prefix.0`, `prefix.1` and so on, in this order."""
    count = sum(name.startswith(f"{prefix}.") for name in named)
    return [named[f"{prefix}.{n}"] for n in range(count)]


def _vectors(channels: Mapping[str, Tensor], names: tuple[str, ...], prefix: str = "") -> Tensor:
    """Channels `[rows, columns]` as the columns of `[rows columns, N]`."""
    return torch.stack([channels[prefix + name].flatten() for name in names], dim=-1)


def _stacked(pictures: list[dict[str, Tensor]]) -> Tensor:
    """Pictures of colours as one tensor `[N, rows, columns, 3]`."""
    return torch.stack([torch.stack([each[name] for name in RGB], dim=-1) for each in pictures])
