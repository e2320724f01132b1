"""A shader in Open Shading Language for Blender Cycles, with the pictures that it reads.

Each lobe becomes the nearest closure with its own normal and tangent; the relief is walked in the
shader. A closure is not negative and knows no measured pairs, so the residual is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import torch
from jinja2 import Environment, PackageLoader, StrictUndefined
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..geometry.directions import MIRROR, frame_from_normal
from ..geometry.relief import steepest
from ..geometry.shapes import broadcast_shape
from ..lobes.cut import view_step
from ..model.relief import STEEPEST
from ..model.spmm import SPMM
from ..runtime.progress import Progress
from . import closures
from .closure_fit import ClosureLobes, fitted
from .closures import KINDS
from .target import Exported

# Cycles keeps 64 closures of a point, which sees four texels. One with a Fresnel term counts twice.
MOST_CLOSURES = 64 // 4
COST = torch.tensor([2 if kind.startswith("SCHLICK") else 1 for kind in KINDS])
SHADER = "spmm.osl"
FLAT, PLANE, HEIGHTS = 0, 1, 2
# Squared error of a closure about the peak of its lobe that is worth a note: 20 dB.
NOTED_ERROR = 0.01


@dataclass(frozen=True)
class Slots:
    """Lobes of all texels, the strongest of each.

    Attributes:
        lobe: lobe of each slot, -1 for none, `[T, M]`.
        weight: `[T, M, C]`.
        lost: share of all weights that found no slot.
    """

    lobe: Tensor
    weight: Tensor
    lost: float


@dataclass(frozen=True)
class ShaderPage:
    """What the template of the shader asks for; see `osl_shader/spmm.osl`."""

    width: int
    height: int
    slots: int
    lobes: int
    mirror: int
    horizon_sine: float
    relief: int
    low: float
    high: float
    steepest: float
    kinds: tuple[str, ...] = KINDS


@dataclass(frozen=True)
class ClosureMaterial:
    """What the shader evaluates, in torch.

    Attributes:
        model: gives the places of texels and the frames of lobes.
        slots: lobes of all texels.
        closures: closure of each lobe.
    """

    model: SPMM
    slots: Slots
    closures: ClosureLobes

    @torch.no_grad()
    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Cosine-weighted RGB `[..., 3]` of uv `[..., 2]`, wi and wo `[..., 3]`."""
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        uv, wi, wo = (
            part.expand(*shape, n).reshape(-1, n).float().cpu()
            for part, n in ((uv, 2), (wi, 3), (wo, 3))
        )
        model = self.model
        texel, bilinear = model.texels_seen(uv.to(model.weight), wo.to(model.weight))
        texel, bilinear = texel.cpu(), bilinear.float().cpu()
        query, corner, slot = torch.nonzero(self.slots.lobe[texel] >= 0, as_tuple=True)
        at = texel[query, corner]
        rho = self._lobes(self.slots.lobe[at, slot], wi[query], wo[query])  # [E]
        weight = self.slots.weight[at, slot] * (bilinear[query, corner] * rho)[:, None]
        return torch.zeros(len(uv), 3).index_add(0, query, weight).view(*shape, 3)

    def _lobes(self, lobe: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Closures `[E]` of lobes `[E]` at wi and wo `[E, 3]` of the texel."""
        normal, angle = (x.detach().float().cpu() for x in (self.model.normal, self.model.angle))
        frame = frame_from_normal(normal, angle)[lobe]  # [E, 3, 3]
        a, b = ((frame @ w[..., None]).squeeze(-1) for w in (wi, wo))
        value = closures.value(self.closures.kind[lobe], self.closures.parameters[lobe], a, b)
        value = value * view_step(b[:, 2], self.model.horizon) * self.closures.scale[lobe]
        return value * (wi[:, 2] > 0.0) * (wo[:, 2] > 0.0)


def write(place: Path, model: SPMM, settings: Any, progress: Progress) -> Exported:
    """Writes the shader and its pictures; see `Target.write`."""
    found = fitted(model.dictionary.detach().to("cpu"))
    slots = slots_of(model, found)
    (place / SHADER).write_text(shader_text(model, slots), encoding="utf-8")
    write_picture(place / "entries.exr", entry_picture(model, slots))
    write_picture(place / "lobes.exr", lobe_picture(model, found))
    if _relief_kind(model) == HEIGHTS:
        write_picture(place / "heights.exr", height_picture(model))
    return Exported(ClosureMaterial(model, slots, found), notes(model, slots, found))


def slots_of(model: SPMM, found: ClosureLobes) -> Slots:
    """The strongest lobes of each texel, as many as Cycles keeps.

    Args:
        model: T texels of J lobes.
        found: closure of each lobe.
    """
    count = model.lobe_count_per_texel().cpu()
    weight, index = model.weight.detach().float().cpu(), model.index.cpu()
    size = max(1, int(count.max()))
    has = torch.arange(size) < count[:, None]  # [T, M]
    lobe = torch.full(has.shape, -1)
    lobe[has] = index
    weights = torch.zeros(*has.shape, weight.shape[1])
    weights[has] = weight
    order = weights.sum(-1).masked_fill(~has, -1.0).argsort(dim=1, descending=True)
    lobe, kept = lobe.gather(1, order), weights.gather(1, order[..., None].expand(-1, -1, 3))
    cost = COST[found.kind][lobe.clamp(min=0)].cumsum(1)  # those without a lobe are last
    has = (lobe >= 0) & (cost <= MOST_CLOSURES)
    size = max(1, int(has.sum(1).max()))
    lobe, kept = lobe.where(has, -1)[:, :size], kept.where(has[..., None], 0.0)[:, :size]
    total = float(weights.double().sum())
    lost = 1.0 - float(kept.double().sum()) / total if total > 0.0 else 0.0
    return Slots(lobe, kept, lost)


def notes(model: SPMM, slots: Slots, found: ClosureLobes) -> tuple[str, ...]:
    """What the closures lose, one clause each."""
    clauses = []
    if int((slots.lobe >= 0).sum()) < len(model.index):
        clauses.append(
            f"lobes of a texel beyond its strongest {MOST_CLOSURES}, those with a Fresnel term "
            f"counted twice, {100.0 * slots.lost:.2g} % of all weights; Cycles keeps 64 closures "
            f"of a point, which sees four texels"
        )
    uses = torch.bincount(model.index.cpu(), minlength=len(found.kind)).double()
    for index in torch.unique(model.lobe_model).tolist():
        rows = model.lobe_model.cpu() == index
        error = float((found.error[rows] * uses[rows]).sum() / uses[rows].sum().clamp(min=1.0))
        if error > NOTED_ERROR:
            used = torch.unique(found.kind[rows]).tolist()
            names = ", ".join(KINDS[kind].lower() for kind in used)
            clauses.append(
                f"the shape of {MODEL_NAMES[index]} lobes, which become {names}: "
                f"{-10.0 * math.log10(error):.1f} dB about their peaks"
            )
    clauses.append(
        "how lobes end below the lowest measured light; those that lean to it keep their cosine"
    )
    return tuple(clauses)


def shader_text(model: SPMM, slots: Slots) -> str:
    """The shader with the numbers of a model."""
    heights = [0.0] if model.relief is None else model.relief.height.detach().tolist()
    page = ShaderPage(
        model.width,
        model.height,
        slots.lobe.shape[1],
        len(model.lobe_model),
        int(model.rule == MIRROR),
        math.sin(model.horizon),
        _relief_kind(model),
        min(heights),
        max(heights),
        steepest(model.view, STEEPEST),
    )
    environment = Environment(
        loader=PackageLoader("spmm_torch.export", "osl_shader"),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(SHADER).render(page=page)


def entry_picture(model: SPMM, slots: Slots) -> Tensor:
    """RGB weights and one more than the lobe of each slot, `[M H, W, 4]`, 0 where there is none."""
    texels = torch.cat((slots.weight, slots.lobe[..., None] + 1.0), dim=-1)  # [T, M, 4]
    return texels.transpose(0, 1).reshape(-1, model.width, 4)


def lobe_picture(model: SPMM, found: ClosureLobes) -> Tensor:
    """Lobes `[J, 3, 4]`: tangent and kind, normal and scale, then the parameters."""
    normal, angle = (x.detach().float().cpu() for x in (model.normal, model.angle))
    tangent = frame_from_normal(normal, angle)[:, 0]
    rows = (
        torch.cat((tangent, found.kind[:, None].float()), dim=1),
        torch.cat((normal, found.scale[:, None]), dim=1),
        found.parameters,
    )
    return torch.stack(rows, dim=1)


def height_picture(model: SPMM) -> Tensor:
    """Heights in texture widths, `[H, W, 4]`, the same in each channel."""
    assert model.relief is not None
    heights = model.relief.heights(model.texel_count).detach().float().cpu()
    return heights.view(model.height, model.width, 1).expand(-1, -1, 4)


def write_picture(path: Path, picture: Tensor) -> None:
    """Writes four channels `[rows, columns, 4]` as floats in OpenEXR."""
    pixels = np.ascontiguousarray(picture.numpy(), np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with path.open("wb") as file:  # the library takes no path of any bytes
        OpenEXR.File(header, {"RGBA": pixels}).write(file)


def _relief_kind(model: SPMM) -> int:
    """Whether the surface is flat, one plane, or has heights."""
    if model.relief is None:
        return FLAT
    return PLANE if model.relief.encoded()[0] is None else HEIGHTS
