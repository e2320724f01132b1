"""Energy of the lobes that no sample resolves: at most what the surface reflects.

Heights of peaks are known, widths are not. The white-sky reflectance of a lobe, its integral over
all lights, is by quadrature.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...geometry.directions import frame_from_normal
from ...lobes.batch import LobeBatch
from ...lobes.sampling import specular_mask
from .peaks import NARROW, STEEP, Unresolved

# Polar angles of the views at which energy is held, in degrees.
HELD_AT = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
# Rings about the mirror direction at which a lobe is integrated, and points on each.
RINGS, SPOKES = 48, 16
# Least share of its energy that a lobe keeps.
LEAST_FACTOR = 0.01
# Rounds in which the widths of the lobes of a sample share what is too much.
ROUNDS = 20


def held_to_energy(
    lobes: LobeBatch, weights: Tensor, peak: Unresolved, resolved: float
) -> LobeBatch:
    """Lobes of which the narrow ones reflect together at most what the surface does.

    Heights are known, widths are not: those of lobes that reflect too much shrink.

    Args:
        lobes: S x M lobes in the order of the samples.
        weights: of the lobes, `[S, M, C]`, 0 for padding.
        peak: what the samples do not resolve.
        resolved: width of the narrowest lobes that the samples resolve.
    """
    samples, slots, _ = weights.shape
    narrow = specular_mask(lobes, NARROW * resolved).view(samples, slots)
    theta = lobes.normal.new_tensor(HELD_AT).deg2rad()
    own = white_sky(lobes, theta if peak.metal else theta[theta < STEEP]).view(samples, slots, -1)
    bright = weights.sum(1).argmax(1)  # the brightest channel, [S]
    weight = weights.gather(2, bright[:, None, None].expand(-1, slots, 1))  # [S, M, 1]
    energy = weight * own * narrow[..., None]  # [S, M, V]
    wanted = energy.sum(1, keepdim=True).clamp(max=peak.reflectance)
    gram = energy @ energy.transpose(1, 2)
    right = (energy @ wanted.transpose(1, 2)).squeeze(2)  # [S, M]
    factor = torch.ones_like(right)
    for step in range(ROUNDS * slots):  # coordinate descent, each factor in turn
        slot = step % slots
        size = gram[:, slot, slot]
        rest = (gram[:, slot] * factor).sum(1) - size * factor[:, slot]
        best = (right[:, slot] - rest) / size.clamp(min=torch.finfo(size.dtype).tiny)
        factor[:, slot] = torch.where(size > 0.0, best.clamp(LEAST_FACTOR, 1.0), 1.0)
    return lobes.narrowed(factor.flatten().sqrt())


def white_sky(lobes: LobeBatch, theta: Tensor) -> Tensor:
    """Integral over all lights of J lobes, for views of polar angles `theta [V]`: `[J, V]`.

    Light directions lie on rings about the mirror direction, the denser the nearer.
    """
    edges = torch.logspace(-3.5, math.log10(math.pi), RINGS).to(theta)
    edges = torch.cat((edges.new_zeros(1), edges))
    angle = 0.5 * (edges[1:] + edges[:-1])
    area = (edges[:-1].cos() - edges[1:].cos()) * (2.0 * math.pi / SPOKES)
    turn = (torch.arange(SPOKES).to(theta) + 0.5) * (2.0 * math.pi / SPOKES)
    ring = torch.stack(
        (
            angle.sin()[:, None] * turn.cos(),
            angle.sin()[:, None] * turn.sin(),
            angle.cos()[:, None].expand(-1, SPOKES),
        ),
        dim=-1,
    ).flatten(0, 1)  # about z, [N, 3]
    view = torch.stack((theta.sin(), torch.zeros_like(theta), theta.cos()), dim=-1)
    mirror = view * view.new_tensor([-1.0, 1.0, 1.0])
    frame = frame_from_normal(mirror, torch.zeros_like(theta))  # [V, 3, 3]
    light = torch.einsum("nk,vki->vni", ring, frame)
    values = lobes.eval(light[None], view[None, :, None])  # [J, V, N]
    return values @ area.repeat_interleave(SPOKES)
