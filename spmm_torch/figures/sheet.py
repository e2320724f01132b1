"""One picture of many: rows of panels with a label under each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..render.display import Codes

WHITE, BLACK = (255, 255, 255), (0, 0, 0)
MARGIN, GAP, FONT_SIZE, LABEL_HEIGHT = 12, 10, 15, 26


@dataclass(frozen=True)
class Panel:
    """A picture and the label under it."""

    codes: Codes
    label: str


def sheet(rows: Sequence[Sequence[Panel]]) -> Codes:
    """Rows of panels on white; a column is as wide as its widest picture or label."""
    font = ImageFont.load_default(FONT_SIZE)
    columns = max(len(row) for row in rows)
    widths = [
        max(_width(row[column], font) for row in rows if column < len(row))
        for column in range(columns)
    ]
    heights = [max(panel.codes.shape[0] for panel in row) + LABEL_HEIGHT for row in rows]
    width = sum(widths) + GAP * (columns - 1) + 2 * MARGIN
    height = sum(heights) + GAP * (len(rows) - 1) + 2 * MARGIN
    image = Image.new("RGB", (width, height), WHITE)
    draw = ImageDraw.Draw(image)
    top = MARGIN
    for row, row_height in zip(rows, heights, strict=True):
        left = MARGIN
        for panel, column_width in zip(row, widths, strict=False):
            shown = Image.fromarray(np.ascontiguousarray(panel.codes))
            image.paste(shown, (left + (column_width - shown.width) // 2, top))
            middle = (left + column_width / 2, top + row_height - LABEL_HEIGHT / 2)
            draw.text(middle, panel.label, fill=BLACK, font=font, anchor="mm")
            left += column_width + GAP
        top += row_height + GAP
    return np.asarray(image)


def _width(panel: Panel, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> int:
    return max(panel.codes.shape[1], round(font.getlength(panel.label)))
