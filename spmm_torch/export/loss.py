"""How far what was written is from the model: SNR at random queries, FLIP on the sphere."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..edit.edits.residual_strength import residual_strength
from ..edit.parts import flattened
from ..evaluate.flip import flip
from ..evaluate.renderings import compare_materials
from ..evaluate.spheres import LIGHTS, SETTINGS, TEXELS_IN_HALF_TURN, sphere_scene
from ..geometry.warp import square_to_uniform_hemisphere
from ..metrics import snr_db
from ..model.spmm import SPMM
from ..render import Material, Texture
from ..report.wording import decibels
from ..runtime.memory import slices
from .target import RELIEF, RESIDUAL

# Random (uv, wi, wo) of the SNR, and how many are evaluated at once.
QUERIES, BLOCK = 1 << 16, 1 << 14
SEED = 19


@dataclass(frozen=True)
class Loss:
    """Differences of what was written.

    Attributes:
        snr_db: against the whole model.
        held_snr_db: against the parts of the model that the target holds.
        flip: mean FLIP error against the whole model under each light; None without the extra
            `eval`.
    """

    snr_db: float
    held_snr_db: float
    flip: tuple[float, ...] | None

    def line(self) -> str:
        """The figures on one line."""
        text = f"SNR {decibels(self.snr_db)} at {QUERIES:,} random (uv, wi, wo)"
        if self.held_snr_db != self.snr_db:
            text += f", {decibels(self.held_snr_db)} without what is left out"
        if self.flip is None:
            return f"{text}; FLIP needs the extra eval"
        errors = ", ".join(
            f"{error:.4f} ({title[0].lower()}{title[1:]})"
            for error, (title, *_) in zip(self.flip, LIGHTS, strict=True)
        )
        return f"{text}; FLIP on the sphere {errors}"


@torch.no_grad()
def loss_of(model: SPMM, holds: tuple[str, ...], material: Material) -> Loss:
    """The differences of a material from the model that it stands for.

    Args:
        model: with three channels.
        holds: parts of the model that the target holds; see `target.PARTS`.
        material: what was written.
    """
    whole = random_snr(model, material)
    held = without_parts(model, holds)
    return Loss(
        whole,
        whole if held is model else random_snr(held, material),
        sphere_flip(model, material, (model.height, model.width), model.weight.device),
    )


@torch.no_grad()
def random_snr(model: SPMM, material: Material) -> float:
    """SNR in dB of a material at the queries of `random_queries`, cosine-weighted."""
    energy = error = 0.0
    queries = random_queries(QUERIES)
    for part in slices(QUERIES, BLOCK):
        uv, wi, wo = (x[part].to(model.weight) for x in queries)
        value = model(uv, wi, wo).double()
        energy += float(value.square().sum())
        error += float((value - material(uv, wi, wo).to(value)).square().sum())
    return snr_db(energy, error)


def random_queries(count: int) -> tuple[Tensor, Tensor, Tensor]:
    """uv `[Q, 2]` and wi, wo `[Q, 3]`, uniform over the texture and the hemisphere."""
    u = torch.rand(3, count, 2, generator=torch.Generator().manual_seed(SEED))
    return u[0], square_to_uniform_hemisphere(u[1]), square_to_uniform_hemisphere(u[2])


def sphere_flip(
    original: Material, material: Material, size: tuple[int, int], device: torch.device | str
) -> tuple[float, ...] | None:
    """The mean FLIP error under each of the lights of `evaluate.spheres`.

    Args:
        original: what a material is compared with.
        material: on the same device.
        size: H and W of the texture of both.
        device: of the renderings.

    Returns:
        An error for each light; None without the extra `eval`.
    """
    height, width = size
    scene = sphere_scene(Texture(TEXELS_IN_HALF_TURN / width, width / height))
    titles = tuple(title for title, *_ in LIGHTS)
    both = (original, material, material)
    errors = flip(compare_materials(both, scene, SETTINGS, titles, device))
    return None if errors is None else tuple(errors)


def without_parts(model: SPMM, holds: tuple[str, ...]) -> SPMM:
    """The model without the parts that a target does not hold; itself if it has none of them."""
    if RESIDUAL not in holds and has_residual(model):
        model = residual_strength(model, 0.0)
    return model if RELIEF in holds or model.relief is None else flattened(model)


def has_residual(model: SPMM) -> bool:
    """Whether the residual of clusters or of components is anything but 0."""
    clusters, components = model.residual, model.components
    if bool(clusters.code.any()) and bool(clusters.scale.any()):
        return True
    return components is not None and bool(components.intensity().any())
