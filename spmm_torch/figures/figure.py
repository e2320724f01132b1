"""A figure: a picture with a caption, and the numbers that it shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import torch

from ..errors import ConfigError
from ..evaluate import Source
from ..model.spmm import SPMM
from ..render import RenderSettings
from ..render.display import Codes
from ..runtime.progress import Progress


@dataclass(frozen=True)
class Drawing:
    """A figure that was drawn.

    Attributes:
        picture: with labels.
        caption: of the picture.
        values: numbers of the figure, for `figures.json`.
    """

    picture: Codes
    caption: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Choices:
    """The user's choices for all figures.

    Args:
        size: pixels of each rendering.
        samples: eye rays of a pixel.
        texel: column and row of the texel whose lobes are shown; None for the glossiest.
        view: polar angle and azimuth of wo in radians, for pictures of one direction.
        seed: of every random choice.

    Raises:
        ConfigError: a value out of its range.
    """

    size: int = 256
    samples: int = 4
    texel: tuple[int, int] | None = None
    view: tuple[float, float] = (math.radians(45.0), 0.0)
    seed: int = 0

    def __post_init__(self) -> None:
        self.settings()
        if not 0.0 <= self.view[0] < 0.5 * math.pi:
            raise ConfigError(
                f"the view's polar angle is {math.degrees(self.view[0]):g} degrees; expected "
                f"0 or more and less than 90."
            )

    def settings(self) -> RenderSettings:
        """The settings of a rendering."""
        return RenderSettings(self.size, self.samples, seed=self.seed)


@dataclass
class Subject:
    """The run that figures show.

    Attributes:
        model: on `device`.
        open_source: finds and decodes the input of the run; called at first need.
        device: of the renderings.
        choices: of the user.
        progress: of the command.
    """

    model: SPMM
    open_source: Callable[[], Source]
    device: torch.device
    choices: Choices = field(default_factory=Choices)
    progress: Progress = field(default_factory=lambda: Progress(enabled=False))

    @cached_property
    def source(self) -> Source:
        """The run and its decoded input."""
        return self.open_source()

    @property
    def aspect(self) -> float:
        """Width over height of the texture."""
        return self.model.width / self.model.height


@dataclass(frozen=True)
class Figure:
    """A figure of the paper.

    Attributes:
        name: on the command line and of its files.
        title: on the page.
        draw: draws it.
    """

    name: str
    title: str
    draw: Callable[[Subject], Drawing]
