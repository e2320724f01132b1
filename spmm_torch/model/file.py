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
from .components import Components
from .lookup import SparseWeights
from .relief import Relief
from .residual import Residual
from .stored_models import loaded_kappa, loaded_models, stored_kappa, stored_names
from .stored_weights import (
    StoredEntries,
    by_lobe,
    decode_entries,
    decode_weights,
    encode_entries,
    encode_weights,
    is_coded,
)

Tensors = dict[str, Tensor]
# What the tensors whose names begin so count as.
PARTS = {
    "weights": "weights",
    "dictionary": "dictionary",
    "residual": "residual",
    "components": "residual",
}
# Tensors, or all whose names begin so, that texels share: they do not grow with the texture.
SHARED = (
    "dictionary.",
    "residual.",
    "components.code",
    "components.scale",
    "components.coefficient_scale",
    "weights.range",
    "directions.",
)
# Tensors without which a reader of version 1 would show other values than the model has.
VERSION_2 = ("weights.code", "components.", "relief.")
COMPONENTS = ("code", "scale", "coefficient", "coefficient_scale")


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
        components: the residual of each texel; None for none.
        weight_type: number format of the weights in the file: uint8, int16 or float32.
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
    components: Components | None = None
    weight_type: torch.dtype = torch.float32
    relief: Relief | None = None


def needed_version(tensors: Tensors, horizon: float) -> str:
    """The least version of the format that has all parts of a file, given that of its lobes."""
    newer = horizon > 0.0 or any(name.startswith(VERSION_2) for name in tensors)
    return "2" if newer else "1"


def to_tensors(parts: ModelParts) -> tuple[Tensors, dict[str, str]]:
    """The tensors of a model file by name, and its metadata."""
    lobes = parts.lobes
    names = stored_names(lobes.model)
    tensors = {
        **_stored_weights(parts),
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
    if parts.components is not None:
        tensors |= {f"components.{name}": getattr(parts.components, name) for name in COMPONENTS}
    tensors |= _relief_tensors(parts.relief)
    metadata = {
        "version": needed_version(tensors, lobes.horizon),
        "name": parts.name,
        "models": json.dumps(names),
        "height": str(parts.height),
        "width": str(parts.width),
    }
    if lobes.horizon > 0.0:
        metadata["horizon"] = repr(lobes.horizon)
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


def _stored_weights(parts: ModelParts) -> Tensors:
    """The tensors of the entries of all texels by name."""
    weights = parts.weights
    if not is_coded(parts.weight_type):
        return {
            "weights.count": tensor_file.narrow(weights.offset[1:] - weights.offset[:-1]),
            "weights.index": tensor_file.narrow(weights.index),
            "weights.weight": weights.weight,
        }
    weights = by_lobe(weights)
    entries = encode_entries(weights, len(parts.lobes))
    code, limits = encode_weights(weights.weight, parts.weight_type)
    return {
        "weights.count": entries.count,
        "weights.index": entries.index,
        "weights.code": code,
        "weights.range": limits,
    }


def from_tensors(tensors: Tensors, metadata: dict[str, str]) -> ModelParts:
    """The parts that `to_tensors` stored; BRDFs are found by name.

    Raises:
        KeyError: a tensor or a key of the metadata is missing.
        ValueError: a BRDF is not known, a height, a width or the horizon is not a number, the
            relief is not valid, or parts do not fit each other.
    """
    lobes = LobeBatch(
        loaded_models(tensors["dictionary.model"], json.loads(metadata["models"])),
        loaded_kappa(tensors["dictionary.kappa"]),
        tensors["dictionary.normal"],
        tensors["dictionary.angle"],
        float(metadata.get("horizon", 0.0)),
    )
    light, view = tensors["directions.light"], tensors["directions.view"]
    return _fitting(
        ModelParts(
            int(metadata["height"]),
            int(metadata["width"]),
            lobes,
            _loaded_weights(tensors),
            tensors["weights.label"].long(),
            Residual(tensors["residual.code"], tensors["residual.scale"], light, view),
            light,
            view,
            metadata["name"],
            _loaded_components(tensors, light, view),
            tensors["weights.code"].dtype if "weights.code" in tensors else torch.float32,
            relief=_relief(tensors, metadata),
        )
    )


def _fitting(parts: ModelParts) -> ModelParts:
    """Parts that fit each other: a damaged file would else be met by whoever looks a texel up.

    Raises:
        ValueError: they do not.
    """
    texels, clusters = parts.height * parts.width, len(parts.residual.scale)
    if min(parts.height, parts.width) < 1 or texels != len(parts.labels):
        raise ValueError(f"{parts.width} x {parts.height} texels of {len(parts.labels)}")
    weights = parts.weights
    if len(weights.offset) != texels + 1:
        raise ValueError(f"entries of {len(weights.offset) - 1} texels for {texels}")
    _check_indices(weights.index, len(parts.lobes), "lobe")
    if clusters:  # without residuals of their own, clusters are labels only
        _check_indices(parts.labels, clusters, "cluster")
    return parts


def _check_indices(index: Tensor, count: int, name: str) -> None:
    """Refuses indices `[N]` that are not below `count`."""
    if index.numel() and not 0 <= int(index.min()) <= int(index.max()) < count:
        raise ValueError(f"{name} {int(index.max())} of {count}")


def _loaded_weights(tensors: Tensors) -> SparseWeights:
    """The entries that `_stored_weights` stored."""
    offset, index = decode_entries(
        StoredEntries(tensors["weights.count"], tensors["weights.index"])
    )
    if "weights.code" not in tensors:
        return SparseWeights(offset, index, tensors["weights.weight"])
    weight = decode_weights(tensors["weights.code"], tensors["weights.range"])
    return SparseWeights(offset, index, weight)


def _loaded_components(tensors: Tensors, light: Tensor, view: Tensor) -> Components | None:
    """The components of a file; None if it has none."""
    if "components.code" not in tensors:
        return None
    parts = {name: tensors[f"components.{name}"] for name in COMPONENTS}
    return Components(**parts, light=light, view=view)


def byte_counts(tensors: Tensors) -> dict[str, int]:
    """Stored bytes of weights, dictionary and residual, to which components count."""
    counts = dict.fromkeys(PARTS.values(), 0)
    for name, tensor in tensors.items():
        if part := PARTS.get(name.partition(".")[0]):
            counts[part] += _bytes(tensor)
    return counts


def shared_bytes(tensors: Tensors) -> int:
    """Stored bytes of what all texels share: lobes, functions of the residual, directions."""
    return sum(_bytes(tensor) for name, tensor in tensors.items() if name.startswith(SHARED))


def _bytes(tensor: Tensor) -> int:
    return tensor.numel() * tensor.element_size()
