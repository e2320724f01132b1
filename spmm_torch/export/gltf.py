"""A glTF file of a sphere with the material: metallic-roughness, and the extensions that pay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .. import __version__
from ..edit.parts import flattened
from ..evaluate.spheres import TEXELS_IN_HALF_TURN
from ..model.spmm import SPMM
from ..render import Texture
from ..runtime.progress import Progress
from .glb import LINEAR, MIPMAPPED, TRIANGLES, VERTICES, WRAPS, Buffer
from .surface.fit import Fitted, fit_surface, gain_note, look_of
from .surface.gltf import GLTFSurface
from .surface.textured import Textured
from .target import Exported, NoSettings
from .textures import Plane, axis_planes, normal_planes, picture

# Faces of the sphere around, and from pole to pole; its vertices are counted in two bytes.
AROUND, ALONG = 128, 64


def write(place: Path, model: SPMM, settings: NoSettings, progress: Progress) -> Exported:
    """Writes one .glb file; see `Target.write`."""
    surface, size = GLTFSurface(), (model.height, model.width)
    look = look_of(flattened(model))
    fitted = fit_surface(surface, look, progress)
    buffer = Buffer()
    material, textures = material_of(fitted, size, buffer)
    rule = model.rule
    place.write_bytes(buffer.pack(document(model, buffer, material, rule)))
    seen = Textured(surface, textures, *size, rule=rule, gain=look.gain)
    return Exported(seen, gain_note(look.gain))


def document(model: SPMM, buffer: Buffer, material: dict[str, Any], rule: str) -> dict[str, Any]:
    """The JSON of the file, but for the parts of its buffer."""
    sampler = {"magFilter": LINEAR, "minFilter": MIPMAPPED}
    primitive = sphere(
        buffer, Texture(TEXELS_IN_HALF_TURN / model.width, model.width / model.height)
    )
    used = sorted(material.get("extensions", {}))
    return {
        "asset": {"version": "2.0", "generator": f"spmm_torch {__version__}"},
        **({"extensionsUsed": used} if used else {}),
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "sphere"}],
        "meshes": [{"primitives": [{**primitive, "material": 0}]}],
        "materials": [{"name": model.name or "material", **material}],
        "samplers": [{**sampler, "wrapS": WRAPS[rule], "wrapT": WRAPS[rule]}],
    }


def material_of(
    fitted: Fitted, size: tuple[int, int], buffer: Buffer
) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The material, whose pictures are added to a buffer, and what they hold, `[T, n]` each."""
    values, read = fitted.values, {}
    color = Plane.colour(values["base_color"])
    rough, metal = (Plane.linear(values[name]) for name in ("roughness", "metallic"))
    normal = normal_planes(values["normal"])
    read |= {"base_color": color.read, "roughness": rough.read, "metallic": metal.read}
    read["normal"] = normal.read[:, :2]
    pictures = {
        "base_color": picture(*size, color),
        "metallic_roughness": picture(*size, 0, rough, metal),
        "normal": picture(*size, normal),
    }
    index = {name: {"index": buffer.add_picture(name, png)} for name, png in pictures.items()}
    material: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "baseColorTexture": index["base_color"],
            "metallicRoughnessTexture": index["metallic_roughness"],
        },
        "normalTexture": index["normal"],
    }
    extensions = {}
    for layer in fitted.layers:
        png, extension, more = LAYERS[layer](values, size)
        number = {"index": buffer.add_picture(layer, png)}
        textures = {key: number for key, value in extension.items() if value is None}
        extensions[f"KHR_materials_{layer}"] = extension | textures
        read |= more
    if "clearcoat" in fitted.layers:
        extensions["KHR_materials_clearcoat"]["clearcoatNormalTexture"] = index["normal"]
    return material | ({"extensions": extensions} if extensions else {}), read


# A layer: its picture, its extension with None where the texture's number belongs, and the
# parameters that the picture holds.
Layer = tuple[bytes, dict[str, Any], dict[str, Tensor]]


def _specular(values: dict[str, Tensor], size: tuple[int, int]) -> Layer:
    """Reflectance at normal and grazing incidence, over that of a refractive index of 1.5."""
    factor = values["specular_color"].amax(0).clamp(min=1e-3)
    tint = Plane.colour(values["specular_color"], factor)
    weight = Plane.linear(values["specular"])
    extension = {
        "specularTexture": None,
        "specularColorTexture": None,
        "specularColorFactor": factor.tolist(),
    }
    read = {"specular": weight.read, "specular_color": tint.read}
    return picture(*size, tint, weight), extension, read


def _anisotropy(values: dict[str, Tensor], size: tuple[int, int]) -> Layer:
    """The axis along which a highlight is stretched."""
    direction, strength = axis_planes(values["anisotropy"])
    extension = {"anisotropyStrength": 1.0, "anisotropyTexture": None}
    read = {"anisotropy": torch.cat((direction.read, strength.read), dim=1)}
    return picture(*size, direction, strength), extension, read


def _sheen(values: dict[str, Tensor], size: tuple[int, int]) -> Layer:
    """Fibres over the surface."""
    color, rough = Plane.colour(values["sheen_color"]), Plane.linear(values["sheen_roughness"])
    extension = {
        "sheenColorFactor": [1.0, 1.0, 1.0],
        "sheenColorTexture": None,
        "sheenRoughnessFactor": 1.0,
        "sheenRoughnessTexture": None,
    }
    return (
        picture(*size, color, rough),
        extension,
        {
            "sheen_color": color.read,
            "sheen_roughness": rough.read,
        },
    )


def _clearcoat(values: dict[str, Tensor], size: tuple[int, int]) -> Layer:
    """A coat, whose normal is that of the surface; `material_of` adds it."""
    weight, rough = Plane.linear(values["clearcoat"]), Plane.linear(values["clearcoat_roughness"])
    extension = {
        "clearcoatFactor": 1.0,
        "clearcoatTexture": None,
        "clearcoatRoughnessFactor": 1.0,
        "clearcoatRoughnessTexture": None,
    }
    return (
        picture(*size, weight, rough, 0),
        extension,
        {
            "clearcoat": weight.read,
            "clearcoat_roughness": rough.read,
        },
    )


LAYERS = {
    "specular": _specular,
    "anisotropy": _anisotropy,
    "sheen": _sheen,
    "clearcoat": _clearcoat,
}


def sphere(buffer: Buffer, texture: Texture) -> dict[str, Any]:
    """The unit sphere of `render.Sphere` as a primitive, with its tangents."""
    turn = torch.linspace(-torch.pi, torch.pi, AROUND + 1)
    rise = torch.linspace(0.5 * torch.pi, -0.5 * torch.pi, ALONG + 1)[:, None]
    across, up, one = torch.cos(rise), torch.sin(rise), torch.ones_like(rise)
    point = torch.stack((across * turn.sin(), up.expand(-1, AROUND + 1), across * turn.cos()), -1)
    tangent = torch.stack((turn.cos(), 0.0 * turn, -turn.sin(), turn * 0.0 + 1.0), -1)
    u, v = texture.at(turn * one / torch.pi, rise.expand(-1, AROUND + 1) / torch.pi).unbind(-1)
    point = point / point.norm(dim=-1, keepdim=True)
    attributes = {
        "POSITION": point,
        "NORMAL": point,
        "TANGENT": tangent.expand(ALONG + 1, -1, -1),
        "TEXCOORD_0": torch.stack((u, 1.0 - v), -1),  # v runs down in glTF
    }
    return {
        "attributes": {
            name: buffer.add_array(part.flatten(0, 1).contiguous().numpy(), VERTICES)
            for name, part in attributes.items()
        },
        "indices": buffer.add_array(_triangles(), TRIANGLES),
    }


def _triangles() -> np.ndarray:
    """Corners of all triangles, counter-clockwise from outside, but for those without area."""
    row, column = (part.ravel() for part in np.mgrid[0:ALONG, 0:AROUND])
    first = row * (AROUND + 1) + column
    below = first + AROUND + 1
    upper = np.stack((first, below + 1, first + 1), axis=1)[row > 0]
    lower = np.stack((first, below, below + 1), axis=1)[row < ALONG - 1]
    return np.concatenate((upper, lower)).ravel().astype(np.uint16)
