"""Path-trace a BTF from ordinary texture maps with Mitsuba 3."""

from __future__ import annotations

import argparse
from pathlib import Path

from spmm_torch.config.synthesis import SynthesisSettings

from .parser import Parser, add_output, file_name
from .settings import add_settings, read_settings

MAPS = {
    "height": "grey picture of the height, 8 or 16 bits; white is high",
    "albedo": "picture of the base colour, sRGB",
    "roughness": "grey picture of the roughness, linear",
    "metallic": "grey picture of what is metal, linear (default: no metal)",
    "normal": "normal map in OpenGL style (default: the normals of the height map)",
}
REQUIRED = ("height", "albedo", "roughness")


def add_options(parser: Parser) -> None:
    """The options of `spmm synthesize`."""
    for role, meaning in MAPS.items():
        parser.add_argument(
            f"--{role}", type=file_name, required=role in REQUIRED, metavar="MAP", help=meaning
        )
    add_settings(parser, SynthesisSettings)
    add_output(parser, "OUT", "BTF to make: X.zip (8 bits), X.npz, or a folder of EXR pictures")


def run(options: argparse.Namespace) -> list[str]:
    """Traces and writes; the output is whole or not there at all."""
    from spmm_torch.runtime.progress import Progress
    from spmm_torch.synthesize import read_maps, synthesize_btf
    from spmm_torch.synthesize.target import target_of

    settings = read_settings(SynthesisSettings, options)
    target_of(Path(options.output), settings.gamma)  # before the maps: it costs nothing
    maps = read_maps(**{role: getattr(options, role) for role in MAPS})
    progress = Progress()
    for line in maps.unlike():
        progress.say(line)
    return [str(synthesize_btf(maps, options.output, settings, progress))]
