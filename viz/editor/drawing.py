"""Tools that select on the texture: a stroke from pressing the pointer to releasing it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ...edit import Mask
from ...edit.masks.cluster import ClusterMask
from .brush import Point, painted, picture_mask, rectangle_between, texel_under
from .preview import selection_codes
from .session import Session

TOOLS = ("all", "rectangle", "paint", "erase", "cluster")


class Drawing:
    """The selection of a session while it is drawn.

    Args:
        session: that owns the selection.
        folder: where pictures of painted selections are kept until they are saved.

    Attributes:
        tool: one of TOOLS.
        brush: its radius in texture widths.
    """

    def __init__(self, session: Session, folder: Path) -> None:
        self.session, self.folder = session, folder
        self.tool, self.brush = TOOLS[0], 0.08
        self._start: Point | None = None
        self._shown: Mask | None = None
        self._paint: NDArray[np.float32] | None = None

    def choose(self, tool: str) -> None:
        """Takes another tool; `all` selects the whole texture at once."""
        self.tool = tool
        if tool == "all":
            self.session.select(None)

    def press(self, at: Point) -> None:
        """Begins a stroke where the pointer went down."""
        if not _is_place(at):
            return
        model = self.session.original
        self._start = at
        if self.tool == "cluster":
            texel = texel_under(at, model.height, model.width)
            self.session.select(ClusterMask((int(model.labels[texel]),)))
        elif self.tool in ("paint", "erase"):
            self._paint = self._fractions(self.session.mask)
        self.drag(at)

    def drag(self, at: Point) -> None:
        """Continues the stroke."""
        if self._start is None or not _is_place(at):
            return
        if self.tool == "rectangle":
            size = (self.session.original.height, self.session.original.width)
            self._shown = rectangle_between(self._start, at, *size)
        elif self._paint is not None:
            self._paint = painted(self._paint, at, self.brush, self.tool == "erase")

    def drop(self, at: Point) -> None:
        """Ends the stroke and selects what it drew."""
        self.drag(at)
        if self._shown is not None:
            self.session.select(self._shown)
        elif self._paint is not None:
            self.session.select(picture_mask(self._paint, self.folder))
        self._start = self._shown = self._paint = None

    def picture(self) -> NDArray[np.uint8]:
        """The texture `[H, W, 3]` with what is drawn, or else selected, tinted."""
        model, mask = self.session.original, self._shown or self.session.mask
        if self._paint is not None:
            return selection_codes(model, torch.from_numpy(self._paint).flatten())
        return selection_codes(model, None if mask is None else mask.select(model).texels)

    def _fractions(self, mask: Mask | None) -> NDArray[np.float32]:
        """The selected fractions `[H, W]` to paint on; 0 everywhere without a mask."""
        model = self.session.original
        texels = None if mask is None else mask.select(model).texels
        if texels is None:
            return np.zeros((model.height, model.width), dtype=np.float32)
        return texels.view(model.height, model.width).cpu().numpy().astype(np.float32)


def _is_place(at: Point) -> bool:
    """Whether a point is one: a picture that a page shows without a size has none."""
    return all(math.isfinite(part) for part in at)
