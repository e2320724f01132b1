"""The Jacobian of lobes along their search coordinates, by one backward pass for all pairs.

rho of a pair depends on its lobe only through kappa and through wi and wo in the frame of the lobe.
These are the leaves of the backward pass, one set for each pair, so one pass gives their gradients
at all pairs. The derivatives along the coordinates of the frame follow by the chain rule: a small
rotation omega of the frame moves a local direction w by omega x w.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, REGISTRY
from ..brdf.base import above_horizon
from ..geometry.directions import frame_from_normal, normal_from_disk
from .batch import COORDINATES, CUDA_BLOCK, anisotropic_mask, rotate
from .cut import view_step
from .ragged import groups

# Values of one tensor of a block: few enough for the caches, enough to hide the cost of a call.
CPU_BACKWARD_VALUES = 1 << 17
# Tensors that a backward pass holds at once, about: leaves and intermediate results.
LIVE_TENSORS = 64


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
    budget = CUDA_BLOCK // LIVE_TENSORS if wi.is_cuda else CPU_BACKWARD_VALUES
    size = max(1, budget // max(1, shape.numel()))
    for index, of_model in groups(model, len(REGISTRY)):
        for rows in of_model.split(size):
            rho[rows], jacobian[rows] = _block(index, coordinates[rows].detach(), wi, wo, horizon)
    return rho, jacobian


def _block(
    model: int, coordinates: Tensor, wi: Tensor, wo: Tensor, horizon: float
) -> tuple[Tensor, Tensor]:
    """`eval_with_jacobian` of lobes of one model."""
    shape = torch.broadcast_shapes(wi.shape[1:-1], wo.shape[1:-1])
    frame = _frames(model, coordinates)
    local = [
        part.expand(len(coordinates), *shape).contiguous().requires_grad_()
        for w in (wi, wo)
        for part in rotate(frame, w).unbind(-1)
    ]  # components of wi, then of wo, [J, ...] each
    kappa, kappa_derivative = _parameters(model, coordinates, len(shape))
    kappa = [part.expand_as(local[0]).contiguous().requires_grad_() for part in kappa]
    with torch.enable_grad():
        rho = _eval(model, kappa, local, horizon) * above_horizon(wi, wo)  # Eq. (3)
        gradients = torch.autograd.grad(
            rho.sum(), local + kappa, allow_unused=True, materialize_grads=True
        )
    jacobian = rho.new_zeros(len(coordinates), COORDINATES, *shape)
    torque = _cross(local[:3], gradients[:3]) + _cross(local[3:], gradients[3:6])  # [3, J, ...]
    for column, turn in enumerate(_turns(model, coordinates, frame)):  # [J, 3] each
        axis = turn.detach().view(len(turn), *[1] * len(shape), 3)
        jacobian[:, column] = sum(axis[..., k] * torque[k] for k in range(3))
    for column, part in enumerate(kappa_derivative):
        jacobian[:, 3 + column] = part * gradients[6 + column]
    return rho.detach(), jacobian


def _eval(model: int, kappa: list[Tensor], local: list[Tensor], horizon: float) -> Tensor:
    """f_r (n_j . wi) `[J, ...]` of kappa and local wi and wo, by components `[J, ...]`."""
    padding = [torch.zeros_like(local[0])] * (MAX_PARAMETERS - len(kappa))
    parameters = torch.stack(kappa + padding).movedim(0, -1)
    wi, wo = (torch.stack(local[first : first + 3]).movedim(0, -1) for first in (0, 3))
    rho = REGISTRY[model].eval(parameters, wi, wo) * wi[..., 2].clamp(min=0.0)
    return rho * view_step(wo[..., 2], horizon) if horizon > 0.0 else rho


def _frames(model: int, coordinates: Tensor) -> Tensor:
    """Rotations `[J, 3, 3]` into the frames of lobes, by their search coordinates."""
    angle = coordinates[:, 2] * anisotropic_mask(torch.tensor(model)).to(coordinates)
    return frame_from_normal(normal_from_disk(coordinates[:, :2]), angle)


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


def _turns(model: int, coordinates: Tensor, frame: Tensor) -> list[Tensor]:
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
    about_normal = torch.zeros_like(normal)
    about_normal[:, 2] = -1.0
    return turns + [about_normal] * REGISTRY[model].anisotropic


def _cross(a: list[Tensor], b: tuple[Tensor, ...]) -> Tensor:
    """a x b by components: `[3, J, ...]`."""
    return torch.stack(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    ).detach()
