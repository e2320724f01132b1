"""Look at the lobes of a model: in a window, as a PNG, or as an HTML file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from spmm_torch.errors import ConfigError

from .inputs import check_place, check_run
from .parser import Parser, add_against, add_run, file_name, whole_number
from .places import texel, view_angles

if TYPE_CHECKING:
    from spmm_torch.model.spmm import SPMM
    from spmm_torch.viz.scene import Scene

COMMAND = "spmm view"
MOSAIC = 8


def add_options(parser: Parser) -> None:
    """The options of `spmm view`."""
    add = parser.add_argument
    add_run(parser, "run folder or model file")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--texel",
        type=texel,
        metavar="X,Y",
        help="lobes of one texel, counted from the top left (default: the middle one)",
    )
    what.add_argument(
        "--mosaic",
        nargs="?",
        type=whole_number,
        const=MOSAIC,
        metavar="N",
        help=f"lobes of N x N texels over the texture; 1 to 32 (default: {MOSAIC})",
    )
    what.add_argument("--maps", action="store_true", help="maps of normals, counts and models")
    add(
        "--view",
        type=view_angles,
        default="45,0",
        metavar="THETA,PHI",
        help="view direction wo in degrees (default: %(default)s)",
    )
    add_against(parser)
    add("--save", type=file_name, metavar="X.png", help="picture to make; needs no screen")
    add(
        "--html",
        type=file_name,
        metavar="X.html",
        help="page to make, one offline file that turns in a browser",
    )


def run(options: argparse.Namespace) -> list[str]:
    """Shows or writes what the command line asks for.

    Raises:
        SPMMError: bad input, or something is missing on this machine.
    """
    _check(options)
    from spmm_torch.model.spmm import SPMM
    from spmm_torch.viz.html import save_html
    from spmm_torch.viz.plotter import save_picture, show

    scene = scene_of(options, SPMM.load(options.run))
    written = []
    for path, save in ((options.save, save_picture), (options.html, save_html)):
        if path is not None:
            save(scene, path)
            written.append(path)
    if not written:
        show(scene)
    return written


def scene_of(options: argparse.Namespace, model: SPMM) -> Scene:
    """What is shown of a model."""
    import torch

    from spmm_torch.geometry.directions import direction_from_angles
    from spmm_torch.viz.maps import maps_scene
    from spmm_torch.viz.measured import measured_input, measured_samples
    from spmm_torch.viz.mosaic import mosaic_scene
    from spmm_torch.viz.texel import texel_index, texel_lobes
    from spmm_torch.viz.texel_scene import texel_scene

    if options.maps:
        return maps_scene(model)
    wo = direction_from_angles(*torch.tensor(options.view, dtype=torch.float64))
    if options.mosaic is not None:
        return mosaic_scene(model, options.mosaic, wo)
    x, y = options.texel or (model.width // 2, model.height // 2)
    index = texel_index(model, x, y)
    btf = measured_input(Path(options.run), options.against, options.pattern)
    measured = None if btf is None else measured_samples(btf, model, index, wo)
    name = f"Texel {x}, {y} of {model.name or 'the model'}"
    return texel_scene(name, texel_lobes(model, index), wo, measured)


def _check(options: argparse.Namespace) -> None:
    """Refuses what cannot go on, before any work is done."""
    from spmm_torch.viz.requirements import require_packages, require_window, use_offscreen

    check_run(options.run)
    for path in filter(None, (options.save, options.html)):
        check_place(path, replaces=True)
    for option, suffix in (("save", ".png"), ("html", ".html")):
        path = getattr(options, option)
        if path is not None and Path(path).suffix.lower() != suffix:
            raise ConfigError(f"--{option} is {path}; expected a name that ends in {suffix}.")
    require_packages(COMMAND, "pyvista", *(("trame_vtk",) if options.html else ()))
    if options.save or options.html:
        use_offscreen(COMMAND)
    else:
        require_window(COMMAND)
