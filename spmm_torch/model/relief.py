"""The relief of a model: heights of its surface, one byte a texel, and drifts of its pictures."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..geometry.directions import REPEAT, RULES
from ..geometry.neighbours import measured_alike
from ..geometry.relief import HeightField, steepest
from .changes import changes

CODE_MAX = 255  # largest code of a height, which has one byte
# Steepest view that is walked, |wo_xy| / wo_z: 83 degrees. Measured views are less grazing.
STEEPEST = 8.0
# Greatest height over or under the plane, in units of the texture's width: deeper reliefs would
# show another copy of the texture, and take much memory.
MAX_HEIGHT = 0.5


class Relief(nn.Module):
    """Heights over the plane in which pictures were rectified, in units of the texture's width.

    Heights are a parameter, which starts without gradient. A file stores them as
    `offset + scale * code`, rounded to one byte; a plane alone has one height and no codes.

    Args:
        code: `[T]` uint8; None for a plane alone.
        scale: height of one step of the codes.
        offset: height of code 0, or of the plane.
        rule: how the texture continues beyond its border, its lobes too: `repeat` or `mirror`.
        drift: registration of the picture of each measured view, `[V, 2]` in units of u and v:
            it shows at a place what an exact one shows at the place plus the drift. It counts for
            errors against measured pictures only. None: unknown.

    Raises:
        ValueError: unknown rule, or heights beyond `MAX_HEIGHT`.
    """

    scale: Tensor
    offset: Tensor
    drift: Tensor | None

    def __init__(
        self,
        code: Tensor | None,
        scale: Tensor | float,
        offset: Tensor | float,
        rule: str = REPEAT,
        drift: Tensor | None = None,
    ) -> None:
        super().__init__()
        if rule not in RULES:
            raise ValueError(f"rule {rule}; known: {', '.join(RULES)}")
        self.rule = rule
        device = code.device if code is not None else None
        for name, value in (("scale", scale), ("offset", offset)):
            value = torch.as_tensor(value, dtype=torch.float32, device=device)
            self.register_buffer(name, value.detach().clone())
        height = self.offset[None] if code is None else _decoded(code, self.scale, self.offset)
        if float(height.abs().amax()) > MAX_HEIGHT:
            raise ValueError(f"heights of the relief beyond {MAX_HEIGHT} texture widths")
        self.height = nn.Parameter(height.clone(), requires_grad=False)
        self.register_buffer("drift", drift)
        self._field: tuple[tuple[object, ...], HeightField] | None = None

    @classmethod
    def of_heights(cls, height: Tensor, rule: str = REPEAT, drift: Tensor | None = None) -> Relief:
        """The relief of heights `[T]`, rounded to what a file holds; equal ones are a plane."""
        return cls(*encode_heights(height.detach()), rule, drift)

    def with_heights(self, height: Tensor) -> Relief:
        """The same rule and drift with other heights `[T]`."""
        return Relief.of_heights(height, self.rule, self.drift)

    def drift_of(self, view: Tensor, measured: Tensor) -> Tensor:
        """The drift `[N, 2]` of the pictures of some views; 0 for those that were not measured.

        Args:
            view: unit vectors `[N, 3]`.
            measured: all measured views, `[V, 3]`.
        """
        drift = torch.zeros(len(view), 2, device=view.device)
        if self.drift is None:
            return drift
        known, index = measured_alike(view, measured)
        return torch.where(known[:, None], self.drift.to(drift)[index], drift)

    def encoded(self) -> tuple[Tensor | None, Tensor, Tensor]:
        """(code `[T]` uint8 or None, scale `[]`, offset `[]`) of the heights as a file has them.

        Heights that lie on the present steps keep them, so that a file read is the file written.
        """
        height, scale, offset = self.height.detach(), self.scale, self.offset
        if len(height) > 1 and float(scale) > 0.0:
            code = ((height - offset) / scale).round().clamp(0, CODE_MAX).to(torch.uint8)
            if torch.equal(_decoded(code, scale, offset), height):
                return code, scale.float(), offset.float()
        return encode_heights(height)

    def heights(self, texels: int) -> Tensor:
        """The height of each of T texels, `[T]`."""
        return self.height.expand(texels)

    def field(self, rows: int, columns: int, view: Tensor, rule: str | None = None) -> HeightField:
        """The heights over H x W texels, for the walk of rays.

        It is kept as long as the heights stay as they are and need no gradient. Changes through
        `.data`, or in inference mode of heights made there, which torch does not count, are not
        seen.

        Args:
            rows, columns: H and W.
            view: measured views `[V, 3]`: more grazing ones shift as much as the steepest of them.
            rule: how heights continue beyond the border; None: by the rule of the relief.
        """
        height, rule = self.height, rule or self.rule
        live = torch.is_grad_enabled() and height.requires_grad
        key = (
            height.data_ptr(),
            changes(height),
            height.dtype,
            rows,
            columns,
            view.data_ptr(),
            rule,
        )
        if not live and self._field is not None and self._field[0] == key:
            return self._field[1]
        over = (height if live else height.detach()).expand(rows * columns).view(rows, columns)
        field = HeightField(over, rule, steepest(view, STEEPEST))
        if not live:
            self._field = key, field
        return field


def encode_heights(height: Tensor) -> tuple[Tensor | None, Tensor, Tensor]:
    """(code `[T]` uint8, scale `[]`, offset `[]`) of heights `[T]`; no code where all are equal."""
    low, high = torch.aminmax(height.float())
    scale = (high - low) / CODE_MAX
    if not bool(scale > 0.0):
        return None, torch.zeros_like(low), low
    code = ((height.float() - low) / scale).round().clamp(0, CODE_MAX).to(torch.uint8)
    return code, scale, low


def _decoded(code: Tensor, scale: Tensor, offset: Tensor) -> Tensor:
    """Heights `[T]` of codes `[T]`."""
    return offset + scale * code
