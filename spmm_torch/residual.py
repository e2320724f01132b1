"""The residual function of each cluster: storage, and evaluation between measured directions."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .geometry import HemisphereInterpolation

FLOAT16_MAX = 65504.0  # largest finite half
# Measured lights may lie on the horizon itself, where a cosine of 0 has no ratio to 0.
LOWEST_COSINE = 1e-6


class Residual(nn.Module):
    """One signed function per cluster on V x L measured pairs [WDR11 §4.1].

    Values are kept as `code * scale`, where `code` fills the range of its type: float16 codes
    then have 11 bits relative precision whatever the range of the data.

    Args:
        code: `[K, V, L, C]`, float16 or float32.
        scale: `[K]` float32.
        light: `[L, 3]`.
        view: `[V, 3]`.
    """

    def __init__(self, code: Tensor, scale: Tensor, light: Tensor, view: Tensor) -> None:
        super().__init__()
        self.code = nn.Parameter(code, requires_grad=False)
        self.register_buffer("scale", scale)
        self.light_mesh = HemisphereInterpolation.build(light)
        self.view_mesh = HemisphereInterpolation.build(view)
        self.lowest_light = max(float(light[:, 2].min()), LOWEST_COSINE)

    def forward(self, cluster: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """The residual `[..., C]` of clusters `[...]` at wi, wo `[..., 3]`, piecewise linear.

        Measured pairs return their stored value. Lights below the lowest measured ring fade with
        their cosine; 0 where wi or wo is under the horizon.
        """
        light, light_weight = self.light_mesh.to(wi.device).weights(wi)  # [..., 3]
        view, view_weight = self.view_mesh.to(wo.device).weights(wo)  # [..., 3]
        corners = self.code[cluster[..., None, None], view[..., :, None], light[..., None, :]].to(
            wi.dtype
        )  # [..., 3, 3, C]
        value = torch.einsum("...v,...l,...vlc->...c", view_weight, light_weight, corners)
        fade = (wi[..., 2] / self.lowest_light).clamp(max=1.0) * (wi[..., 2] > 0.0)
        return value * (self.scale.to(wi.dtype)[cluster] * fade * (wo[..., 2] > 0.0))[..., None]

    def at_pair(self, view: int, light: int) -> Tensor:
        """The stored values `[K, C]` of one measured pair."""
        return self.code[:, view, light].to(self.scale.dtype) * self.scale[:, None]


def encode_residual(values: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Codes and scales of residuals `[K, ...]` for storage as `dtype`.

    Returns:
        (code `[K, ...]`, scale `[K]`), values ~ code * scale.
    """
    if dtype == torch.float32:
        return values.float(), torch.ones(len(values), device=values.device)
    largest = values.flatten(1).abs().amax(1).clamp(min=torch.finfo(torch.float32).tiny)
    # One unit below the top: rounding must not reach infinity.
    scale = largest.float() / (0.5 * FLOAT16_MAX)
    return (values / scale.view(-1, *[1] * (values.dim() - 1))).to(dtype), scale


def decode_residual(code: Tensor, scale: Tensor) -> Tensor:
    """Values `[K, ...]` float32 of codes and scales."""
    return code.float() * scale.view(-1, *[1] * (code.dim() - 1))
