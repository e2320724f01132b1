"""What the parameters of a model may be: training knows nothing of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..geometry.directions import disk_from_normal, normal_from_disk, project_disk

if TYPE_CHECKING:
    from .mixture import Mixture

# Length of normals that rounding leaves, as in files of directions.
LENGTH_TOLERANCE = 2e-3


@torch.no_grad()
def flaw(model: Mixture) -> str | None:
    """What is wrong with the parameters of a model, in words; None if nothing is."""
    for name, value in (*model.named_parameters(), *model.named_buffers()):
        if value.is_floating_point() and not bool(value.isfinite().all()):
            return f"{name} holds NaN or infinity"
    if bool((model.weight < 0.0).any()):
        return f"weight goes down to {float(model.weight.min()):g}, below 0"
    length = model.normal.norm(dim=-1)
    if bool(((length - 1.0).abs() > LENGTH_TOLERANCE).any()):
        return "normal holds vectors that are not unit"
    return None


@torch.no_grad()
def project(model: Mixture) -> None:
    """Takes weights, normals and kappa of a model to the nearest that are valid, in place."""
    model.weight.clamp_(min=0.0)
    model.normal.copy_(_valid_normals(model.normal))
    low, high = (bound.to(model.kappa)[model.lobe_model] for bound in _kappa_bounds(model.kappa))
    model.kappa.copy_(torch.minimum(torch.maximum(model.kappa, low), high))


def _valid_normals(normal: Tensor) -> Tensor:
    """Unit normals `[J, 3]`, tilted by at most MAX_TILT; valid ones keep their bits."""
    length = normal.norm(dim=-1, keepdim=True)
    disk = disk_from_normal(normal / length).nan_to_num()  # NaN: straight down, or of no length
    kept = project_disk(disk)
    off = ((length - 1.0).abs() > LENGTH_TOLERANCE) | (normal[:, 2:] < 0.0)
    return torch.where(off | (kept != disk).any(-1, keepdim=True), normal_from_disk(kept), normal)


def _kappa_bounds(kappa: Tensor) -> tuple[Tensor, Tensor]:
    """Least and largest kappa of each BRDF, `[len(REGISTRY), P]`; any where it has none."""
    low = torch.full((len(REGISTRY), kappa.shape[1]), -torch.inf)
    high = -low
    for index, brdf in enumerate(REGISTRY):
        for column, row in enumerate(brdf.parameters[: kappa.shape[1]]):
            low[index, column], high[index, column] = row.low, row.high
    return low, high
