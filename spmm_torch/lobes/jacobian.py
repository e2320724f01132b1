"""The Jacobian of lobes along their search coordinates, by one backward pass for all pairs.

rho of a pair depends on its lobe only through kappa and through wi and wo in the frame of the lobe.
These are the leaves of the backward pass, one set for each pair, so one pass gives their gradients
at all pairs. The derivatives along the coordinates of the frame follow by the chain rule: a small
rotation omega of the frame moves a local direction w by omega x w.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import cast

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, REGISTRY
from ..brdf.base import Vectors, above_horizon
from ..geometry.directions import frame_from_normal, normal_from_disk
from ..runtime.memory import slices
from .batch import COORDINATES
from .cut import view_step
from .ragged import Spans, groups, in_spans, spans_within
from .values import rotate

# Values of one tensor of a block. On a CPU few enough for the caches, and enough to hide the cost
# of a call. On a GPU lobes of all models share a block, which takes 4 GB in a backward pass.
CPU_BACKWARD_VALUES, CUDA_BACKWARD_VALUES = 1 << 17, 1 << 24


def eval_with_jacobian(
    model: Tensor, coordinates: Tensor, wi: Tensor, wo: Tensor, horizon: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Values of lobes and their Jacobian [WDR11 Eq. 3].

    Args:
        model: `[J]`.
        coordinates: search coordinates `[J, COORDINATES]`.
        wi, wo: directions `[1, ..., 3]`, broadcast as in `LobeBatch.eval`.
        horizon: of the lobes, as in `LobeBatch`.

    Returns:
        rho `[J, ...]` and d rho / d coordinates `[J, COORDINATES, ...]`, which is 0 along
        coordinates that a model does not have.
    """
    shape = torch.broadcast_shapes(wi.shape[1:-1], wo.shape[1:-1])
    rho = coordinates.new_zeros(len(model), *shape)
    jacobian = coordinates.new_zeros(len(model), COORDINATES, *shape)
    for spans, rows in _blocks(model, shape.numel()):
        found = _block(spans, coordinates[rows].detach(), wi, wo, horizon)
        rho[rows], jacobian[rows] = found
    return rho, jacobian


def _blocks(model: Tensor, pairs: int) -> Iterator[tuple[Spans, Tensor]]:
    """Lobes in blocks of so many pairs: where each model lies in the block, and indices `[B]`."""
    if model.is_cuda:
        order, spans = in_spans(model, len(REGISTRY))
        for part in slices(len(order), max(1, CUDA_BACKWARD_VALUES // max(1, pairs))):
            yield spans_within(spans, part), order[part]
        return
    for index, of_model in groups(model, len(REGISTRY)):
        for rows in of_model.split(max(1, CPU_BACKWARD_VALUES // max(1, pairs))):
            yield [(index, slice(0, len(rows)))], rows


def _block(
    spans: Spans, coordinates: Tensor, wi: Tensor, wo: Tensor, horizon: float
) -> tuple[Tensor, Tensor]:
    """`eval_with_jacobian` of lobes in the order of their models."""
    shape = torch.broadcast_shapes(wi.shape[1:-1], wo.shape[1:-1])
    turns = _has_tangent(spans, coordinates)
    frame = frame_from_normal(normal_from_disk(coordinates[:, :2]), coordinates[:, 2] * turns)
    local = [
        part.expand(len(coordinates), *shape).contiguous()
        for w in (wi, wo)
        for part in rotate(frame, w).unbind(-1)
    ]  # components of wi, then of wo, [J, ...] each
    values, leaves, derivatives = [], [], []
    for model, rows in spans:
        kappa, derivative = _parameters(model, coordinates[rows], len(shape))
        own = [part[rows].detach().requires_grad_() for part in local]
        own += [part.expand_as(own[0]).contiguous().requires_grad_() for part in kappa]
        with torch.enable_grad():
            values.append(_eval(model, own[6:], own[:6], horizon))
        leaves.append(own)
        derivatives.append(derivative)
    with torch.enable_grad():
        rho = _joined(values) * above_horizon(wi, wo)  # Eq. (3)
        found = torch.autograd.grad(
            rho.sum(), [*chain.from_iterable(leaves)], allow_unused=True, materialize_grads=True
        )
    ends = iter(found)
    gradients = [[next(ends) for _ in own] for own in leaves]
    jacobian = rho.new_zeros(len(coordinates), COORDINATES, *shape)
    slopes = [_joined([own[column] for own in gradients]) for column in range(6)]
    torque = _cross(local[:3], slopes[:3]) + _cross(local[3:], slopes[3:])  # [3, J, ...]
    for column, turn in enumerate(_turns(spans, coordinates, frame)):  # [J, 3] each
        axis = turn.detach().view(len(turn), *[1] * len(shape), 3)
        jacobian[:, column] = sum(axis[..., k] * torque[k] for k in range(3))
    for (_, rows), own, derivative in zip(spans, gradients, derivatives, strict=True):
        for column, part in enumerate(derivative):
            jacobian[rows, 3 + column] = part * own[6 + column]
    return rho.detach(), jacobian


def _joined(parts: list[Tensor]) -> Tensor:
    """Tensors `[n, ...]` one after another; a single one is not copied."""
    return parts[0] if len(parts) == 1 else torch.cat(parts)


def _eval(model: int, kappa: list[Tensor], local: list[Tensor], horizon: float) -> Tensor:
    """f_r (n_j . wi) `[J, ...]` of kappa and local wi and wo, by components `[J, ...]`."""
    padding = [torch.zeros_like(local[0])] * (MAX_PARAMETERS - len(kappa))
    parts = (kappa + padding, local[:3], local[3:])
    parameters, wi, wo = (cast("Tensor", Vectors(tuple(part))) for part in parts)
    rho = REGISTRY[model].eval(parameters, wi, wo) * wi[..., 2].clamp(min=0.0)
    return rho * view_step(wo[..., 2], horizon) if horizon > 0.0 else rho


def _has_tangent(spans: Spans, like: Tensor) -> Tensor:
    """1 for each lobe of a model that has a tangent, else 0, `[J]`."""
    found = like.new_zeros(len(like))
    for model, rows in spans:
        if REGISTRY[model].anisotropic:
            found[rows] = 1.0
    return found


def _parameters(
    model: int, coordinates: Tensor, dimensions: int
) -> tuple[list[Tensor], list[Tensor]]:
    """Parameters and their derivatives along [0, 1], `[J, 1, ...]` each."""
    table = REGISTRY[model].parameters
    if not table:
        return [], []
    unit = coordinates[:, 3 : 3 + len(table)].detach().requires_grad_()
    with torch.enable_grad():
        pairs = zip(table, unit.unbind(-1), strict=True)
        value = torch.stack([row.from_unit(column) for row, column in pairs])
        derivative = torch.autograd.grad(value.sum(), unit)[0].T
    shape = (len(table), len(coordinates), *[1] * dimensions)
    return list(value.detach().reshape(shape)), list(derivative.reshape(shape))


def _turns(spans: Spans, coordinates: Tensor, frame: Tensor) -> list[Tensor]:
    """Rotations omega `[J, 3]` of the frames, in local axes, along disk x, disk y and the angle.

    As n moves by dn, the shortest rotation from z to n turns about n by
    (n_x dn_y - n_y dn_x) / (1 + n_z).
    """
    x, y = coordinates[:, 0], coordinates[:, 1]
    normal = frame[:, 2]
    stretch = torch.sqrt(2.0 - x * x - y * y)
    mixed = -x * y / stretch
    turns = []
    for step in (
        torch.stack((stretch - x * x / stretch, mixed, -2.0 * x), dim=1),  # d normal / d disk x
        torch.stack((mixed, stretch - y * y / stretch, -2.0 * y), dim=1),
    ):
        local = (frame @ step[..., None])[..., 0]
        spin = (normal[:, 0] * step[:, 1] - normal[:, 1] * step[:, 0]) / (1.0 + normal[:, 2])
        turns.append(torch.stack((local[:, 1], -local[:, 0], spin), dim=1))
    if not any(REGISTRY[model].anisotropic for model, _ in spans):
        return turns
    about_normal = torch.zeros_like(normal)
    about_normal[:, 2] = -_has_tangent(spans, coordinates)
    return [*turns, about_normal]


def _cross(a: list[Tensor], b: list[Tensor]) -> Tensor:
    """a x b by components: `[3, J, ...]`."""
    return torch.stack(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    ).detach()
