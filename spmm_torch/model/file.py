"""A model as the named tensors of its file, in compact types, and back.

`docs/model_format.md` describes it for readers in other languages.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from ..runtime import tensor_file
from .lookup import SparseWeights
from .relief import Relief
from .residual import Residual
from .stored_models import loaded_kappa, loaded_models, stored_kappa, stored_names

Tensors = dict[str, Tensor]
PARTS = ("weights", "dictionary", "residual")
# Parts that a reader of version 1 would leave out, and show other values than the model has.
VERSION_2_PARTS = ("relief",)


@dataclass(frozen=True)
class ModelParts:
    """The parts of a model.

    Attributes:
        height, width: texels of the texture, H and W.
        lobes: the dictionary, J lobes.
        weights: entries of all texels.
        labels: cluster of each texel, `[T]`.
        residual: epsilon_k of each cluster.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
        name: of the material.
        relief: heights of the surface; None where it is flat.
    """

    height: int
    width: int
    lobes: LobeBatch
    weights: SparseWeights
    labels: Tensor
    residual: Residual
    light: Tensor
    view: Tensor
    name: str
    relief: Relief | None = None


def needed_version(tensors: Tensors) -> int:
    """The least version of the format that has all parts of a file."""
    return 2 if any(name.partition(".")[0] in VERSION_2_PARTS for name in tensors) else 1


def to_tensors(parts: ModelParts) -> tuple[Tensors, dict[str, str]]:
    """The tensors of a model file by name, and its metadata."""
    offset, lobes = parts.weights.offset, parts.lobes
    names = stored_names(lobes.model)
    tensors = {
        "weights.count": tensor_file.narrow(offset[1:] - offset[:-1]),
        "weights.index": tensor_file.narrow(parts.weights.index),
        "weights.weight": parts.weights.weight,
        "weights.label": tensor_file.narrow(parts.labels),
        "dictionary.model": tensor_file.narrow(lobes.model),
        "dictionary.kappa": stored_kappa(lobes.kappa, names),
        "dictionary.normal": lobes.normal,
        "dictionary.angle": lobes.angle,
        "residual.code": parts.residual.code,
        "residual.scale": parts.residual.scale,
        "directions.light": parts.light,
        "directions.view": parts.view,
    }
    tensors |= _relief_tensors(parts.relief)
    metadata = {
        "version": str(needed_version(tensors)),
        "name": parts.name,
        "models": json.dumps(names),
        "height": str(parts.height),
        "width": str(parts.width),
    }
    if parts.relief is not None:
        metadata["rule"] = parts.relief.rule
    return tensors, metadata


def _relief_tensors(relief: Relief | None) -> Tensors:
    """The tensors of a relief; none without one."""
    if relief is None:
        return {}
    code, scale, offset = relief.encoded()
    tensors = {"relief.offset": offset[None]}
    if code is not None:
        tensors |= {"relief.code": code, "relief.scale": scale[None]}
    if relief.drift is not None:
        tensors["relief.drift"] = relief.drift
    return tensors


def _relief(tensors: Tensors, metadata: dict[str, str]) -> Relief | None:
    """The relief that `_relief_tensors` stored.

    Raises:
        KeyError: a tensor or the rule is missing.
        ValueError: the rule is unknown, or heights are out of their range.
    """
    if "relief.offset" not in tensors:
        return None
    code = tensors.get("relief.code")
    scale = 0.0 if code is None else tensors["relief.scale"][0]
    drift = tensors.get("relief.drift")
    return Relief(code, scale, tensors["relief.offset"][0], metadata["rule"], drift)


def from_tensors(tensors: Tensors, metadata: dict[str, str]) -> ModelParts:
    """The parts that `to_tensors` stored; BRDFs are found by name.

    Raises:
        KeyError: a tensor or a key of the metadata is missing.
        ValueError: a BRDF is not known, a height or width is not a number, or the relief is not
            valid.
    """
    lobes = LobeBatch(
        loaded_models(tensors["dictionary.model"], json.loads(metadata["models"])),
        loaded_kappa(tensors["dictionary.kappa"]),
        tensors["dictionary.normal"],
        tensors["dictionary.angle"],
    )
    count = tensors["weights.count"].long()
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    light, view = tensors["directions.light"], tensors["directions.view"]
    return ModelParts(
        int(metadata["height"]),
        int(metadata["width"]),
        lobes,
        SparseWeights(offset, tensors["weights.index"].long(), tensors["weights.weight"]),
        tensors["weights.label"].long(),
        Residual(tensors["residual.code"], tensors["residual.scale"], light, view),
        light,
        view,
        metadata["name"],
        relief=_relief(tensors, metadata),
    )


def byte_counts(tensors: Tensors) -> dict[str, int]:
    """Stored bytes of weights, dictionary and residual."""
    counts: dict[str, int] = dict.fromkeys(PARTS, 0)
    for name, tensor in tensors.items():
        part = name.partition(".")[0]
        if part in counts:
            counts[part] += tensor.numel() * tensor.element_size()
    return counts
