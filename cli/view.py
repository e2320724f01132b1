"""The command `spmm view`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import torch
from torch import Tensor

from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.model.spmm import SPMM
from spmm_torch.viz.html import save_html
from spmm_torch.viz.maps import maps_scene
from spmm_torch.viz.measured import measured_input, measured_samples
from spmm_torch.viz.mosaic import mosaic_scene
from spmm_torch.viz.plotter import save_picture, show
from spmm_torch.viz.requirements import require_packages, require_window, use_offscreen
from spmm_torch.viz.scene import Scene
from spmm_torch.viz.texel import texel_index, texel_lobes
from spmm_torch.viz.texel_scene import texel_scene

COMMAND = "spmm view"
MOSAIC = 8
VIEW = "45,0"


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm view`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        for path in view(options):
            print(path)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm view`."""
    result = argparse.ArgumentParser(
        prog=COMMAND,
        description="Look at the lobes of a model: in a window, a PNG or an HTML file.",
    )
    add = result.add_argument
    add("run", metavar="RUN", help="run folder or model file")
    what = result.add_mutually_exclusive_group()
    what.add_argument("--texel", metavar="X,Y", help="lobes of one texel (default: the middle one)")
    what.add_argument(
        "--mosaic",
        nargs="?",
        type=int,
        const=MOSAIC,
        metavar="N",
        help=f"lobes of N x N texels over the texture (default {MOSAIC})",
    )
    what.add_argument("--maps", action="store_true", help="maps of normals, counts and models")
    add("--view", default=VIEW, metavar="THETA,PHI", help=f"wo in degrees (default {VIEW})")
    add("--against", metavar="INPUT", help="measured BTF beside it (default: the one of the run)")
    add("--save", metavar="X.png", help="write a picture; needs no screen")
    add("--html", metavar="X.html", help="write one offline file that turns in a browser")
    return result


def view(options: argparse.Namespace) -> list[Path]:
    """Shows or writes what the command line asks for; returns the files that were written.

    Raises:
        SPMMError: bad input, or something is missing on this machine.
    """
    _check(options)
    model = SPMM.load(options.run)
    scene = _scene(options, model)
    written = []
    for path, save in ((options.save, save_picture), (options.html, save_html)):
        if path is not None:
            save(scene, path)
            written.append(Path(path))
    if not written:
        show(scene)
    return written


def _check(options: argparse.Namespace) -> None:
    """Refuses what cannot go on, before any work is done."""
    for option, suffix in (("save", ".png"), ("html", ".html")):
        path = getattr(options, option)
        if path is not None and Path(path).suffix.lower() != suffix:
            raise ConfigError(f"--{option} is {path}; expected a name that ends in {suffix}.")
    require_packages(COMMAND, "pyvista", *(("trame_vtk",) if options.html else ()))
    if options.save or options.html:
        use_offscreen(COMMAND)
    else:
        require_window(COMMAND)


def _scene(options: argparse.Namespace, model: SPMM) -> Scene:
    if options.maps:
        return maps_scene(model)
    wo = parse_view(options.view)
    if options.mosaic is not None:
        return mosaic_scene(model, options.mosaic, wo)
    x, y = parse_texel(options.texel) if options.texel else (model.width // 2, model.height // 2)
    texel = texel_index(model, x, y)
    btf = measured_input(Path(options.run), options.against)
    measured = None if btf is None else measured_samples(btf, model, texel, wo)
    name = f"Texel {x}, {y} of {model.name or 'the model'}"
    return texel_scene(name, texel_lobes(model, texel), wo, measured)


def parse_texel(text: str) -> tuple[int, int]:
    """Column and row of `--texel`.

    Raises:
        ConfigError: not two whole numbers.
    """
    words = text.split(",")
    if len(words) != 2 or not all(word.strip().lstrip("-").isdigit() for word in words):
        raise ConfigError(f"--texel is {text!r}; expected X,Y such as 12,30.")
    return int(words[0]), int(words[1])


def parse_view(text: str) -> Tensor:
    """The unit vector `[3]` of `--view`, given in degrees.

    Raises:
        ConfigError: not two numbers, or not above the horizon.
    """
    try:
        theta, phi = (math.radians(float(word)) for word in text.split(","))
    except ValueError:
        raise ConfigError(f"--view is {text!r}; expected THETA,PHI in degrees.") from None
    if not (0.0 <= theta < 0.5 * math.pi and math.isfinite(phi)):
        raise ConfigError(f"--view is {text!r}; expected THETA from 0 to below 90 degrees.")
    return direction_from_angles(*torch.tensor([theta, phi], dtype=torch.float64))
