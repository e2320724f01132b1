"""Values of lobes in the frame of each: f_r (n_j . wi), where a lobe ends [WDR11 Eq. 3]."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..brdf.base import Vectors, above_horizon
from ..errors import DataError
from ..geometry.directions import frame_from_normal
from .cut import lit_cosine, view_step
from .ragged import Spans

# Three rows of three entries of matrices, `[...]` each.
Rotation = tuple[tuple[Tensor, ...], ...]


def _check_precision(*tensors: Tensor) -> None:
    """Raises DataError if a tensor has fewer than the 24 bits of float32."""
    for tensor in tensors:
        if tensor.dtype in (torch.float16, torch.bfloat16):
            raise DataError(
                f"lobes were given in {tensor.dtype}, too coarse for narrow lobes; expected "
                f"float32 or float64; convert with .float()."
            )


def eval_model(
    model: int,
    kappa: Tensor,
    normal: Tensor,
    angle: Tensor,
    wi: Tensor,
    wo: Tensor,
    horizon: float = 0.0,
    lowest: float = 0.0,
) -> Tensor:
    """rho `[J, ...]` of J lobes of one model [WDR11 Eq. 3]; fastest if components are contiguous.

    Args:
        model: index into `MODEL_NAMES`.
        kappa, normal, angle, horizon, lowest: of the lobes, as in `LobeBatch`.
        wi, wo: directions `[1 or J, ..., 3]`, as in `LobeBatch.eval`.

    Raises:
        DataError: kappa or directions in float16 or bfloat16.
    """
    _check_precision(kappa, wi, wo)
    middle = (1,) * (max(wi.ndim, wo.ndim) - 2)
    rotation = entries(frame_from_normal(normal, angle).view(-1, *middle, 3, 3))
    parameters = kappa.view(kappa.shape[0], *middle, kappa.shape[1])
    return eval_rotated(model, parameters, rotation, wi, wo, horizon, lowest)


def eval_rotated(
    model: int,
    kappa: Tensor,
    rotation: Rotation,
    wi: Tensor,
    wo: Tensor,
    horizon: float = 0.0,
    lowest: float = 0.0,
) -> Tensor:
    """`eval_model` of lobes whose frames are known: `[...]`; leading dimensions broadcast.

    Args:
        model, horizon, lowest: as in `eval_model`.
        kappa: parameters `[..., P]`.
        rotation: rows of the frames, see `frame_from_normal`; entries `[...]`.
        wi, wo: directions `[..., 3]`.
    """
    local_wi, local_wo = _rotated(rotation, wi), _rotated(rotation, wo)
    directions = (cast("Tensor", Vectors(tuple(local))) for local in (local_wi, local_wo))
    value = REGISTRY[model].eval(kappa, *directions)
    cosine = lit_cosine(local_wi[2].clamp(min=0.0), rotation[2][2], wi[..., 2], lowest)
    if horizon > 0.0:
        cosine = cosine * view_step(local_wo[2], horizon)
    return value * (cosine * above_horizon(wi, wo))  # Eq. (3)


def eval_models(
    spans: Spans,
    kappa: Tensor,
    normal: Tensor,
    angle: Tensor,
    wi: Tensor,
    wo: Tensor,
    horizon: float = 0.0,
    lowest: float = 0.0,
) -> Tensor:
    """rho `[J, ...]` of lobes in the order of their models, given where the lobes of each lie.

    The other arguments are those of `eval_model`.
    """
    _check_precision(kappa, wi, wo)
    rotation = frame_from_normal(normal, angle)  # [J, 3, 3]
    local_wi, local_wo = rotate(rotation, wi), rotate(rotation, wo)
    middle = max(wi.ndim, wo.ndim) - 2
    parameters = kappa.view(kappa.shape[0], *(1,) * middle, kappa.shape[1])
    parts = [
        REGISTRY[model].eval(parameters[rows], local_wi[rows], local_wo[rows])
        for model, rows in spans
    ]
    value = parts[0] if len(parts) == 1 else torch.cat(parts)
    cosine = local_wi[..., 2].clamp(min=0.0)
    upright = normal[:, 2].view(-1, *(1,) * (cosine.ndim - 1))
    cosine = lit_cosine(cosine, upright, wi[..., 2], lowest)
    if horizon > 0.0:
        cosine = cosine * view_step(local_wo[..., 2], horizon)
    return value * (cosine * above_horizon(wi, wo))  # Eq. (3)


def rotate(rotation: Tensor, w: Tensor) -> Tensor:
    """Local directions `[J, ..., 3]` of `w [1 or J, ..., 3]`, for `rotation [J, 3, 3]`.

    Each component is contiguous.
    """
    if w.is_cuda and not torch.is_grad_enabled():  # all rows at once; never rounded to TF32
        parts = w.movedim(-1, 0).unsqueeze(2)  # [3, 1 or J, 1, ...]
        columns = rotation.movedim(-1, 0).reshape(3, -1, 3, *(1,) * (w.ndim - 2))  # [3, J, 3, ...]
        local = columns[0] * parts[0] + columns[1] * parts[1] + columns[2] * parts[2]
        return local.movedim(1, -1)
    rows = entries(rotation.view(-1, *(1,) * (w.ndim - 2), 3, 3))
    return torch.stack(_rotated(rows, w)).movedim(0, -1)


def entries(rotation: Tensor) -> Rotation:
    """The rows of matrices `[..., 3, 3]`, entry by entry, `[...]` each."""
    return tuple(row.unbind(-1) for row in rotation.unbind(-2))


def _rotated(rows: Rotation, w: Tensor) -> list[Tensor]:
    """Components `[...]` of local directions, contiguous, of `w [..., 3]`.

    Written out, because matrix libraries are slow for products of 3 x 3 matrices.
    """
    x, y, z = w.movedim(-1, 0).contiguous().unbind()
    return [a * x + b * y + c * z for a, b, c in rows]
