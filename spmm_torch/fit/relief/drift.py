"""The drift of registration: a shift of each view that no height explains.

Each view is registered to the mean of all others under the same lights, first by correlation to a
whole texel, then by Lucas and Kanade's steps [LK81]. Lights shade differently, so that each light
tells its own shift; how much they differ is the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .pictures import PictureStack

# Texels of the largest shift that the correlation seeks, and shifts by Lucas and Kanade after it.
REACH = 4
STEPS = 3
# Texels of a side of the window in which a drift, the same for all texels, is measured.
WINDOW = 96
# Standard errors under which a drift is noise, and the root mean square in texels under which it
# is worth nothing: path-traced materials, which have none, show up to half of that.
SIGNIFICANCE, LEAST_DRIFT = 3.0, 0.1


@dataclass(frozen=True)
class Drift:
    """The drift of each view, beside what a plane and one shift of all views explain.

    Attributes:
        shift: columns and rows, in texels, `[V, 2]`: a view shows at p + shift what belongs at p.
        error: standard error of either component, `[V]`.
        plane: height that the shifts have in common, in texture widths, to be added to all heights.
    """

    shift: Tensor
    error: Tensor
    plane: float

    def is_noise(self, total: Tensor) -> bool:
        """Whether shifts `[V, 2]` are no more than what lights differ by, or too small to matter.

        Args:
            total: shifts, of which `shift` is the last part.
        """
        size = float(total.square().mean().sqrt())
        return size < max(LEAST_DRIFT, SIGNIFICANCE * float(self.error.square().mean().sqrt()))


def find_drift(stack: PictureStack, height: Tensor, steep: Tensor | None = None) -> Drift:
    """The drift of each view over points of `height [H, W]`, besides `stack.drift`.

    Args:
        stack: pictures.
        height: heights, in texture widths.
        steep: views `[V]` bool whose shifts tell the plane; None: all.
    """
    total, error = torch.zeros_like(stack.drift), torch.zeros_like(stack.drift[:, 0])
    for step in range(1 + STEPS):
        moved = replace(stack, drift=stack.drift + total)
        pictures, weight = _windows(moved, height)
        reference, known = _others(pictures, weight)
        find = _correlation_shift if step == 0 else _gradient_shift
        shift, error = find(pictures, reference, known)
        total = total + shift
    total, plane = without_plane(total, stack.slope, steep)
    return Drift(total, error, plane)


def without_plane(
    shift: Tensor, slope: Tensor, steep: Tensor | None = None
) -> tuple[Tensor, float]:
    """The `shift [V, 2]` less its mean and what a plane would explain, and that plane's height.

    Args:
        shift: columns and rows of each view.
        slope: columns and rows for unit height, `[V, 2]`.
        steep: views `[V]` bool that tell the mean and the plane; None: all.
    """
    told = slice(None) if steep is None else steep
    mean, mean_slope = shift[told].mean(0), slope[told].mean(0)
    centred, direction = shift[told] - mean, slope[told] - mean_slope
    along = (centred * direction).sum() / direction.square().sum().clamp(min=1e-12)
    return shift - mean - along * (slope - mean_slope), -float(along)


def _windows(stack: PictureStack, height: Tensor) -> tuple[Tensor, Tensor]:
    """Aligned pictures `[V, L, h, w]` of the window, and their weights of the same shape."""
    window = (_middle(stack.size[0]), _middle(stack.size[1]))
    pictures, weights = [], []
    for run in stack.runs():
        values, weight = stack.aligned(run, height[None], window)
        pictures.append(values[:, 0])
        weights.append(weight.expand_as(values)[:, 0])
    return torch.cat(pictures), torch.cat(weights)


def _middle(size: int) -> slice:
    first = max((size - WINDOW) // 2, 0)
    return slice(first, min(first + WINDOW, size))


def _others(pictures: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """For each view the mean of all others, and the weight of both: `[V, L, h, w]` each."""
    weighted = weight * pictures
    seen = weight.sum(0) - weight
    mean = (weighted.sum(0) - weighted) / seen.clamp(min=1e-6)
    return mean, weight * (seen > 0.25 * weight.sum(0))


def _correlation_shift(pictures: Tensor, reference: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Whole shifts `[V, 2]` at which pictures correlate best with the reference, and no error."""
    spectrum = torch.fft.rfft2(known * pictures)
    other = torch.fft.rfft2((known > 0.0) * reference)
    size = pictures.shape[-2:]
    correlation = torch.fft.irfft2((spectrum * other.conj()).sum(1), s=size)  # [V, h, w]
    reach = [min(REACH, (side - 1) // 2) for side in size]
    near = correlation.roll(reach, (1, 2))[:, : 2 * reach[0] + 1, : 2 * reach[1] + 1]
    best = near.flatten(1).argmax(1)
    row, column = best // near.shape[2] - reach[0], best % near.shape[2] - reach[1]
    shift = torch.stack((column, row), dim=1).to(pictures.dtype)
    return shift, torch.zeros_like(shift[:, 0])


def _gradient_shift(pictures: Tensor, reference: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Shifts `[V, 2]` that take least squares off the difference [LK81], and their errors `[V]`."""
    gain = (known * pictures * reference).sum((2, 3), keepdim=True)
    gain = gain / (known * reference.square()).sum((2, 3), keepdim=True).clamp(min=1e-6)
    expected = gain * reference
    both = 0.5 * (pictures + expected)
    down, across = torch.gradient(both, dim=(2, 3))
    weighted_down, weighted_across = known * down, known * across
    cross = (weighted_across * down).sum((2, 3))
    rows = (
        torch.stack(((weighted_across * across).sum((2, 3)), cross), dim=-1),
        torch.stack((cross, (weighted_down * down).sum((2, 3))), dim=-1),
    )
    normal = torch.stack(rows, dim=-2)  # [V, L, 2, 2]
    difference = expected - pictures
    right = torch.stack(
        [(weighted * difference).sum((2, 3)) for weighted in (weighted_across, weighted_down)],
        dim=-1,
    )
    matrix = normal.sum(1)  # [V, 2, 2]
    ridge = 1e-6 * matrix.diagonal(dim1=1, dim2=2).sum(1) + 1e-12
    matrix = matrix + ridge[:, None, None] * torch.eye(2, device=matrix.device)
    # The ridge leaves no matrix singular; a check would let the host wait.
    shift = torch.linalg.solve_ex(matrix, right.sum(1)[..., None]).result[..., 0]
    return shift.clamp(-1.0, 1.0), _error_of_lights(matrix, normal, right, shift)


def _error_of_lights(matrix: Tensor, normal: Tensor, right: Tensor, shift: Tensor) -> Tensor:
    """Standard error `[V]` of a component of `shift [V, 2]`, from how much lights differ.

    Args:
        matrix: sum over lights of the normal matrices, `[V, 2, 2]`.
        normal: normal matrices, `[V, L, 2, 2]`.
        right: right sides, `[V, L, 2]`.
        shift: the shifts that solve all lights together.
    """
    lights = normal.shape[1]
    left = right - (normal @ shift[:, None, :, None])[..., 0]  # [V, L, 2], each light's wish
    wish = torch.linalg.solve_ex(matrix[:, None], left[..., None]).result[..., 0]
    spare = lights / max(lights - 1, 1)
    return (0.5 * spare * wish.square().sum((1, 2))).sqrt()
