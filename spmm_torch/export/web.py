"""One offline HTML page that shows a model in real time, by WebGL 2.

The page holds the model file and the shader that evaluates it, both compressed; nothing is lost.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import torch
from jinja2 import Environment, PackageLoader, StrictUndefined
from torch import Tensor

from ..brdf import REGISTRY
from ..edit.widths import power_law
from ..evaluate.spheres import TEXELS_IN_HALF_TURN
from ..geometry.directions import direction_from_angles
from ..geometry.hemisphere import HemisphereInterpolation
from ..geometry.relief import steepest
from ..lobes.sampling import specular_mask
from ..model.relief import STEEPEST
from ..model.spmm import SPMM
from ..render.display import white_exposure
from ..runtime import tensor_file
from ..runtime.progress import Progress
from .glsl import glsl, reflectance_shader
from .loss import has_residual
from .target import Exported

FOLDER = files("spmm_torch.export") / "web_page"
# Scripts in the order in which they name each other.
SCRIPTS = (
    "model",
    "cells",
    "textures",
    "program",
    "shapes",
    "camera",
    "controls",
    "stage",
    "queries",
    "main",
)
SHADERS = ("shape.vert", "shape.frag", "screen.vert", "mean.frag", "show.frag", "queries.frag")
# Copies of the texture that the slider goes up to.
MOST_COPIES = 8
# Light of the picture that tells the exposure, and how bright its brightest parts are shown.
LIGHT_THETA, SHOWN_WHITE = math.radians(30.0), 0.8


@dataclass(frozen=True)
class Page:
    """What the template of the page asks for.

    Attributes:
        title, caption: of the material.
        style, boot: texts; `boot` is the script that unpacks all others.
        copies: of the texture across half a turn of the sphere, at first.
        groups: whether the model has lobes or a part of that name.
        widths: whether a group of lobes has one whose width can be scaled.
        model: the model file, compressed, as text.
        texts: scripts, shaders by name, and what they have to know: JSON, compressed, as text.
    """

    title: str
    caption: str
    style: str
    boot: str
    copies: int
    groups: dict[str, bool]
    widths: dict[str, bool]
    model: str
    texts: str


def write(place: Path, model: SPMM, settings: Any, progress: Progress) -> Exported:
    """Writes the page; see `Target.write`.

    Raises:
        OutputError: a lobe has a BRDF without GLSL.
    """
    place.write_text(page_text(model), encoding="utf-8")
    return Exported(model)


@torch.no_grad()
def page_text(model: SPMM) -> str:
    """The whole page of a model of three channels.

    Raises:
        OutputError: a lobe has a BRDF without GLSL.
    """
    specular = specular_mask(model.dictionary.detach())
    shaders = {name: glsl(name) for name in SHADERS}
    shaders["show.frag"] = glsl("tone_mapping.glsl") + shaders["show.frag"]
    texts = {
        "script": "\n".join(map(script, SCRIPTS)),
        "shaders": {"model.glsl": reflectance_shader(model), **shaders},
        "facts": facts(model),
    }
    page = Page(
        model.name or "material",
        caption(model),
        (FOLDER / "style.css").read_text(encoding="utf-8"),
        script("boot"),
        min(max(round(TEXELS_IN_HALF_TURN / model.width), 1), MOST_COPIES),
        groups(model, specular),
        {"diffuse": has_widths(model, ~specular), "specular": has_widths(model, specular)},
        compressed(model, specular),
        deflated(json.dumps(texts).encode()),
    )
    environment = Environment(
        loader=PackageLoader("spmm_torch.export", "web_page"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(page=page)


def script(name: str) -> str:
    """A script of the page."""
    return (FOLDER / "js" / f"{name}.js").read_text(encoding="utf-8")


def deflated(content: bytes) -> str:
    """Bytes as deflated base64."""
    return base64.b64encode(zlib.compress(content, 9)).decode("ascii")


def caption(model: SPMM) -> str:
    """What the model is made of, on one line."""
    parts = [f"{model.width} × {model.height} texels", f"{len(model.lobe_model)} lobes"]
    if model.components is not None:
        parts.append(f"residual of rank {model.components.rank}")
    if len(model.residual.code):
        parts.append(f"residual of {len(model.residual.code)} clusters")
    if _has_heights(model):
        parts.append("relief")
    return ", ".join(parts)


def groups(model: SPMM, specular: Tensor) -> dict[str, bool]:
    """Which sliders make sense.

    Args:
        model: of the page.
        specular: which of its lobes are, `[J]` bool.
    """
    return {
        "diffuse": bool((~specular).any()),
        "specular": bool(specular.any()),
        "residual": has_residual(model),
        "relief": _has_heights(model),
    }


def has_widths(model: SPMM, group: Tensor) -> bool:
    """Whether a lobe of a group `[J]` bool has a width."""
    used = torch.unique(model.lobe_model[group]).tolist()
    return any(row.from_width is not None for index in used for row in REGISTRY[index].parameters)


def compressed(model: SPMM, specular: Tensor) -> str:
    """The model file as deflated base64, with what the page needs beside it.

    Args:
        model: of the page.
        specular: which of its lobes are, `[J]` bool.
    """
    tensors, metadata = model.to_tensors()
    tensors.pop("relief.drift", None)  # counts for errors against measured pictures only
    tensors["page.specular"] = specular.to(torch.uint8)
    for name, directions in (("light", model.light), ("view", model.view)):
        tensors[f"page.{name}_cells"] = tensor_file.narrow(cells(directions))
    return deflated(tensor_file.pack(tensors, metadata))


def cells(directions: Tensor) -> Tensor:
    """Corners `[F, 3]` of the cells between directions `[N, 3]`; N stands for -z."""
    mesh = HemisphereInterpolation.build(directions)
    corners = mesh.triangles.clone()
    corners[mesh.third == 0.0, 2] = len(directions)
    return corners


def facts(model: SPMM) -> dict[str, Any]:
    """What the script has to know beside the model file."""
    code = None if model.relief is None else model.relief.encoded()[0]
    return {
        "aspect": model.width / model.height,
        "horizon_sine": math.sin(model.horizon),
        "lowest_light": model.lowest_light,
        "steepest": steepest(model.view, STEEPEST),
        "lowest_view": model.lowest_view,
        "mean_code": 0.0 if code is None else float(code.double().mean()),
        "exposure": exposure(model),
        "widths": [
            [
                {
                    "column": n,
                    "power": power_law(row.from_width)[1],
                    "low": row.low,
                    "high": row.high,
                }
                for n, row in enumerate(brdf.parameters)
                if row.from_width is not None
            ]
            for brdf in REGISTRY
        ],
    }


def exposure(model: SPMM) -> float:
    """The factor that shows the bright parts of the material well, seen from above."""
    like = model.weight
    wi = direction_from_angles(like.new_tensor(LIGHT_THETA), like.new_tensor(0.0))
    picture = model.picture(wi, like.new_tensor([0.0, 0.0, 1.0]))
    return SHOWN_WHITE * white_exposure(picture.clamp(min=0.0).cpu().numpy())


def _has_heights(model: SPMM) -> bool:
    """Whether the surface is more than a plane."""
    return model.relief is not None and model.relief.encoded()[0] is not None
