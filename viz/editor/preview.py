"""The pictures of the editor: original and edited.

There are three stages: coarse, for edits too slow to follow; sharp, with the nearest texel of each
pixel, while an edit is dragged; and smooth, with bilinear texels, once nothing moves.
"""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ...config.editor import EditorSettings
from ...model.spmm import SPMM
from ...render.display import auto_exposure, display_codes
from ..palette import PAGE, Colour
from ..slice_picture import slice_codes
from .lobe_cache import never
from .stage import Setting, Stage

SIZE = EditorSettings.size
# Sharp pixels along the side of a coarse one.
COARSE = 2
# Seconds; a picture that is expected to take longer is shown coarse.
BUDGET = 0.07
# Fewest pairs whose time tells the pace.
PACE_PAIRS = 20_000
# Quality of JPEGs: no visible loss, and a fifth of the bytes and time of a PNG.
QUALITY = 93
SELECTED: Colour = (0.0, 0.45, 0.70)
SHADE = 0.6


class Preview:
    """Pictures of models under one setting.

    Args:
        original: the model before edits.
        setting: shape, light and view.
        size: pixels along each side.
    """

    def __init__(self, original: SPMM, setting: Setting, size: int = SIZE) -> None:
        self.model, self.size = original, size
        self._pace = 0.0  # seconds a pair, as last measured
        self.set(setting)

    def set(self, setting: Setting) -> None:
        """Takes another setting; both pictures get the exposure of the original."""
        self.setting = setting
        self._stages = {"sharp": Stage(self.model, setting, self.size)}
        self._sharp = self._stages["sharp"]
        linear = self._sharp.picture(self.model)
        self.exposure = auto_exposure([linear], [self._sharp.coverage])
        self.original, self._is_smooth = self._codes(linear), False

    def follow(self, model: SPMM) -> NDArray[np.uint8]:
        """Codes `[size, size, 3]` of an edited model: sharp, or coarse where that is too slow."""
        work = self._sharp.stale(model)
        if work * self._pace > BUDGET:
            linear = self._stage("coarse").picture(model).movedim(-1, 0)[None]
            side = (self.size, self.size)
            wide = torch.nn.functional.interpolate(linear, size=side, mode="bilinear")
            return self._codes(wide[0].movedim(0, -1))
        start = time.perf_counter()
        linear = self._sharp.picture(model)
        if work > PACE_PAIRS:
            self._pace = (time.perf_counter() - start) / work
        return self._codes(linear)

    def finish(self, model: SPMM, stop: Callable[[], bool] = never) -> NDArray[np.uint8]:
        """Smooth codes `[size, size, 3]` of an edited model; `original` becomes smooth, too.

        Raises:
            Stopped: `stop` returned True.
        """
        stage = self._stage("smooth")
        if not self._is_smooth:
            self.original, self._is_smooth = self._codes(stage.picture(self.model, stop)), True
        return self._codes(stage.picture(model, stop))

    def _stage(self, name: str) -> Stage:
        """The stage of a name, made at its first use."""
        if name not in self._stages:
            smooth = name == "smooth"
            size = self.size if smooth else self.size // COARSE
            self._stages[name] = Stage(self.model, self.setting, size, smooth)
        return self._stages[name]

    def _codes(self, linear: Tensor) -> NDArray[np.uint8]:
        """Codes `[S, S, 3]` of a linear picture over the colour of the page."""
        shown = display_codes(linear, self.exposure).astype(np.float32)
        coverage = self._sharp.coverage.cpu().numpy()[..., None]
        page = 255.0 * np.array(PAGE, dtype=np.float32)
        return np.round(shown * coverage + page * (1.0 - coverage)).astype(np.uint8)


def selection_codes(model: SPMM, fraction: Tensor | None) -> NDArray[np.uint8]:
    """The texture `[H, W, 3]` with its selection tinted.

    Args:
        model: of the texture.
        fraction: selected, of each texel `[T]`; None for the plain texture.
    """
    codes = slice_codes(model)
    if fraction is None:
        return codes
    tint = SHADE * fraction.view(model.height, model.width, 1).cpu().numpy()
    mixed = codes * (1.0 - tint) + 255.0 * np.array(SELECTED) * tint
    return np.round(mixed).astype(np.uint8)


def jpeg_uri(codes: NDArray[np.uint8]) -> str:
    """A data URI of a picture that changes often."""
    return _uri(codes, "JPEG", quality=QUALITY, subsampling=0)


def png_uri(codes: NDArray[np.uint8]) -> str:
    """A data URI of a picture whose texels stay sharp."""
    return _uri(codes, "PNG")


def _uri(codes: NDArray[np.uint8], kind: str, **options: int) -> str:
    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, kind, **options)
    text = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f"data:image/{kind.lower()};base64,{text}"
