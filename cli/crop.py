"""Cut a rectangle of texels out of a UBO2003 BTF of JPEG pictures.

The pictures keep their names, JPEG blocks and quantization tables, so that
hardly a value changes, and OUT.zip is read by the same settings as IN. The
rectangle must follow those blocks: all four numbers are multiples of 8, or of
16 where colour is subsampled.
"""

from __future__ import annotations

import argparse

from spmm_torch.config.fit import DataConfig

from .parser import Parser, file_name, whole_number
from .settings import add_settings, read_settings

# The sides of the rectangle.
SIDES = {
    "x": "leftmost column of texels, from 0",
    "y": "topmost row of texels, from 0",
    "width": "width in texels",
    "height": "height in texels",
}


def add_options(parser: Parser) -> None:
    """The options of `spmm crop`."""
    add = parser.add_argument
    add("input", type=file_name, metavar="IN", help="BTF to cut from: zip or folder of JPEGs")
    add("output", type=file_name, metavar="OUT.zip", help="zip to make; an old one is replaced")
    for name, meaning in SIDES.items():
        add(f"--{name}", type=whole_number, required=True, metavar="N", help=meaning)
    add_settings(parser, DataConfig, "pattern")


def run(options: argparse.Namespace) -> list[str]:
    """Cuts; the zip is whole or not there at all."""
    from spmm_torch.data.crop import crop_ubo2003

    box = (options.x, options.y, options.width, options.height)
    pattern = read_settings(DataConfig, options).pattern
    crop_ubo2003(options.input, *box, options.output, pattern=pattern)
    return [options.output]
