"""Parts of pages: pictures, charts, and rows of pictures."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from ..render.display import Codes
from .pictures import png_uri

# Pictures are shown about this many pixels wide; wider ones look better smoothed.
SHOWN_WIDTH = 220


@dataclass(frozen=True)
class Picture:
    """A picture inside of the page.

    Attributes:
        uri: its data.
        alternative: description for screen readers.
        caption: the text below it.
        pixelated: whether its pixels stay sharp squares.
    """

    uri: str
    alternative: str
    caption: str
    pixelated: bool = False

    @classmethod
    def of_texels(cls, codes: Codes, alternative: str, caption: str) -> Picture:
        """A picture of 8-bit codes `[H, W, 3]`, one pixel for each texel; sharp if it is small."""
        return cls(png_uri(codes), alternative, caption, codes.shape[1] < SHOWN_WIDTH)


@dataclass(frozen=True)
class Chart:
    """A drawing as inline SVG, with its heading and the text below it."""

    title: str
    drawing: Markup
    caption: str = ""


@dataclass(frozen=True)
class PictureRow:
    """Pictures side by side, with their heading and a note beside it."""

    title: str
    note: str
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class Gallery:
    """A section of rows of pictures, with its heading and a note on all of them."""

    title: str
    note: str
    rows: tuple[PictureRow, ...]
