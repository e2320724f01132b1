"""The command `spmm synthesize`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from spmm_torch.errors import SPMMError
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize.maps import read_maps
from spmm_torch.synthesize.pipeline import synthesize_btf, target_of
from spmm_torch.synthesize.settings import RINGS, SCALES, SynthesisSettings
from spmm_torch.synthesize.variant import VARIANTS

MAPS = {
    "height": "grey, 8 or 16 bits; white is high",
    "albedo": "base colour, sRGB",
    "roughness": "grey, linear",
    "metallic": "grey, linear; default: no metal",
    "normal": "OpenGL style; replaces the normals of the height map",
}
REQUIRED = ("height", "albedo", "roughness")
SETTINGS = {
    "relief": "depth from white to black in texture widths",
    "size": "texels across the texture",
    "directions": "of views and of lights: 81 as UBO2003 or 151 as UBO2014",
    "samples": "paths of each texel in each picture",
    "bounces": "of light; 1 is direct light alone",
    "specular": "0.5 is 4 %% reflectivity of what is no metal",
    "scale": "auto: the 99.8th percentile becomes 1 in a zip; none: radiance as it is",
    "gamma": "of the pictures in a zip",
    "seed": "of every random choice",
    "variant": "of Mitsuba",
    "threads": "0 is one for each core",
}
CHOICES = {"directions": tuple(RINGS), "scale": SCALES, "variant": VARIANTS}


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm synthesize`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        settings = SynthesisSettings(**{name: getattr(options, name) for name in SETTINGS})
        target_of(Path(options.output), settings.gamma)  # before the maps: it costs nothing
        maps = read_maps(**{role: getattr(options, role) for role in MAPS})
        output = synthesize_btf(maps, options.output, settings, Progress())
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(output)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm synthesize`."""
    result = argparse.ArgumentParser(
        prog="spmm synthesize",
        description="Path-trace a BTF from ordinary texture maps with Mitsuba 3.",
    )
    for role, meaning in MAPS.items():
        result.add_argument(f"--{role}", required=role in REQUIRED, metavar="MAP", help=meaning)
    for name, meaning in SETTINGS.items():
        default = getattr(SynthesisSettings, name)
        known = f"; one of {', '.join(map(str, CHOICES[name]))}" if name in CHOICES else ""
        result.add_argument(
            f"--{name}",
            type=type(default),
            default=default,
            metavar=name.upper(),
            help=f"{meaning}{known} (default {default})",
        )
    result.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="X.zip, X.npz, or a folder of EXR"
    )
    return result
