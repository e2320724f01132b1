"""A folder with a MaterialX file of an OpenPBR surface, and its textures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..data.codecs import openexr
from ..edit.parts import flattened
from ..model.spmm import SPMM
from ..runtime.progress import Progress
from .mtlx import CURVED_SPACE, WRAPS, Document, Input
from .surface.fit import Fitted, fit_surface, gain_note, look_of
from .surface.openpbr import COAT_IOR, OpenPBRSurface
from .surface.textured import Textured
from .target import Exported, NoSettings
from .textures import Plane, axis_planes, normal_planes, picture

MATERIAL_FILE, HEIGHT_FILE = "material.mtlx", "height.exr"
HEIGHT, MATERIAL = "height", "spmm_material"
COLOURS = ("base_color", "specular_color", "fuzz_color")
# Inputs that stay as they are: an index of 1.5, and a coat that does not darken what is under it.
CONSTANTS = {
    "specular_ior": COAT_IOR,
    "coat_ior": COAT_IOR,
    "coat_darkening": 0.0,
}
# Goes beyond 1: its texture is multiplied by a factor.
FACTORED = "specular_weight"


def write(place: Path, model: SPMM, settings: NoSettings, progress: Progress) -> Exported:
    """Writes the folder; see `Target.write`."""
    surface, size = OpenPBRSurface(), (model.height, model.width)
    look = look_of(flattened(model))
    fitted = fit_surface(surface, look, progress)
    document = Document(WRAPS[model.rule])
    read = write_textures(place, fitted, size, document)
    field = None
    if model.relief is not None:
        field = model.relief.field(*size, model.view)
        height = field.height.detach().cpu().numpy().astype(np.float32)
        (place / HEIGHT_FILE).write_bytes(openexr.encode(np.stack([height] * 3, axis=-1)))
        document.give(HEIGHT, "float", document.add_picture("height_picture", HEIGHT_FILE, "float"))
    if "coat_weight" in read:
        document.give("geometry_coat_normal", "vector3", "normal_world")
    finish(document, MATERIAL)
    (place / MATERIAL_FILE).write_text(document.text(), encoding="utf-8")
    seen = Textured(surface, read, *size, rule=model.rule, field=field, gain=look.gain)
    return Exported(seen, gain_note(look.gain))


def write_textures(
    place: Path, fitted: Fitted, size: tuple[int, int], document: Document
) -> dict[str, Tensor]:
    """Writes a texture for each parameter, which the document names; what they hold, `[T, n]`."""
    read = {}
    for name, plane, factor in _planes(fitted.values):
        (place / f"{name}.png").write_bytes(picture(*size, plane))
        add_texture(document, name, plane.codes.shape[1], factor)
        read[name] = plane.read
    read["normal"] = read["normal"][:, :2]
    if "anisotropy" in fitted.values:
        axis, strength = read.pop("axis"), read.pop("specular_roughness_anisotropy")
        read["anisotropy"] = torch.cat((axis[:, :2], strength), dim=1)
    return read


def _planes(values: dict[str, Tensor]) -> Iterator[tuple[str, Plane, float]]:
    """(name, texture, factor of a renderer) of all parameters."""
    for name, value in values.items():
        if name == "normal":
            yield name, normal_planes(value), 1.0
        elif name == "anisotropy":
            axis, strength = axis_planes(value)
            zero = Plane.linear(torch.zeros_like(value[:, :1]), -1.0, 1.0)
            codes = torch.cat((axis.codes, zero.codes), dim=1)
            yield "axis", Plane(codes, torch.cat((axis.read, zero.read), dim=1)), 1.0
            yield "specular_roughness_anisotropy", strength, 1.0
        elif name in COLOURS:
            yield name, Plane.colour(value), 1.0
        elif name == FACTORED:
            factor = max(1.0, float(value.max()))
            yield name, Plane.linear(value, 0.0, factor), factor
        else:
            yield name, Plane.linear(value), 1.0


def add_texture(document: Document, name: str, channels: int, factor: float) -> None:
    """The picture of a parameter, as the surface's input of that name asks for it."""
    file, node = f"{name}.png", f"{name}_picture"
    if name in COLOURS:
        document.give(name, "color3", document.add_picture(node, file, "color3", CURVED_SPACE))
    elif channels == 1:
        found = document.add_picture(node, file, "float")
        if factor != 1.0:
            inputs = Input.node("float", found), Input.value("float", factor)
            scaled = dict(zip(("in1", "in2"), inputs, strict=True))
            found = document.add(f"{name}_scaled", "multiply", "float", **scaled)
        document.give(name, "float", found)
    elif name == "normal":
        found = Input.node("vector3", document.add_picture(node, file, "vector3"))
        document.give(
            "geometry_normal",
            "vector3",
            document.add("normal_world", "normalmap", "vector3", in_=found),
        )
    else:
        found = Input.node("vector3", document.add_picture(node, file, "vector3"))
        document.give("geometry_tangent", "vector3", _in_world(document, found))


def _in_world(document: Document, codes: Input) -> str:
    """The node of a direction in the plane of the texture, coded from 0 to 1, in the world."""
    vector, one = "vector3", Input.value("float", 1.0)
    twice = document.add("axis_twice", "multiply", vector, in1=codes, in2=Input.value("float", 2.0))
    local = document.add("axis_local", "subtract", vector, in1=Input.node(vector, twice), in2=one)
    parts = document.add("axis_parts", "separate3", "multioutput", in_=Input.node(vector, local))
    world, along = Input.value("string", "world"), []
    for output, base in (("outx", "tangent"), ("outy", "bitangent")):
        axis = Input.node(vector, document.add(base, base, vector, space=world))
        part = Input.node("float", parts, output=output)
        along.append(document.add(f"along_{base}", "multiply", vector, in1=axis, in2=part))
    first, second = (Input.node(vector, name) for name in along)
    total = document.add("axis_sum", "add", vector, in1=first, in2=second)
    return document.add("axis_world", "normalize", vector, in_=Input.node(vector, total))


def finish(document: Document, name: str) -> None:
    """Adds the surface, with all outputs of the graph as inputs, and the material."""
    graph = {key: Input.graph(kind, key) for key, kind in document.outputs.items()}
    height = graph.pop(HEIGHT, None)
    constants = {key: Input.value("float", value) for key, value in CONSTANTS.items()}
    surface = document.add_top(
        "surface", "open_pbr_surface", "surfaceshader", **(constants | graph)
    )
    shaders = {"surfaceshader": Input.node("surfaceshader", surface)}
    if height is not None:
        displaced = document.add_top(
            "relief",
            "displacement",
            "displacementshader",
            displacement=height,
            scale=Input.value("float", 1.0),
        )
        shaders["displacementshader"] = Input.node("displacementshader", displaced)
    document.add_top(name, "surfacematerial", "material", **shaders)
