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
from .residual import Residual
from .stored_models import loaded_kappa, loaded_models, stored_kappa, stored_names

Tensors = dict[str, Tensor]
PARTS = ("weights", "dictionary", "residual")
# Metadata that readers of version 1 do not know and must not leave out.
NEWER_KEYS = {"horizon"}


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
    size = {"height": str(parts.height), "width": str(parts.width)}
    metadata = {"name": parts.name, "models": json.dumps(names), **size}
    if lobes.horizon > 0.0:
        metadata["horizon"] = repr(lobes.horizon)
    return tensors, {**metadata, "version": version(metadata)}


def version(metadata: dict[str, str]) -> str:
    """The version of a file: the first whose readers evaluate it rightly."""
    return "2" if NEWER_KEYS & set(metadata) else "1"


def from_tensors(tensors: Tensors, metadata: dict[str, str]) -> ModelParts:
    """The parts that `to_tensors` stored; BRDFs are found by name.

    Raises:
        KeyError: a tensor or a key of the metadata is missing.
        ValueError: a BRDF is not known, or a height, a width or the horizon is not a number.
    """
    lobes = LobeBatch(
        loaded_models(tensors["dictionary.model"], json.loads(metadata["models"])),
        loaded_kappa(tensors["dictionary.kappa"]),
        tensors["dictionary.normal"],
        tensors["dictionary.angle"],
        float(metadata.get("horizon", 0.0)),
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
    )


def byte_counts(tensors: Tensors) -> dict[str, int]:
    """Stored bytes of weights, dictionary and residual."""
    counts: dict[str, int] = dict.fromkeys(PARTS, 0)
    for name, tensor in tensors.items():
        part = name.partition(".")[0]
        if part in counts:
            counts[part] += tensor.numel() * tensor.element_size()
    return counts
