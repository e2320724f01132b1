"""Draw the figures of the paper for a run.

Writes a PNG of each figure, figures.json with the numbers behind them, and
the page figures.html.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from spmm_torch.config.render import RenderSettings
from spmm_torch.errors import ConfigError

from .inputs import check_place
from .parser import ListAction, Parser, add_output, add_run
from .places import texel, view_angles
from .settings import add_settings, read_settings
from .source import add_source_options, check_source, load_source

if TYPE_CHECKING:
    from spmm_torch.figures import Choices, Drawing, Figure

VALUES, PAGE = "figures.json", "figures.html"


def add_options(parser: Parser) -> None:
    """The options of `spmm figures`."""
    add = parser.add_argument
    add_run(parser)
    add_output(parser, "OUT", "folder to make")
    add(
        "--only",
        metavar="NAME,...",
        help="names of the figures to draw, such as figure3,figure10 (default: all)",
    )
    add("--list", action=ListAction, lines=figure_lines, help="print the names of all figures")
    add("--lobes-alone", action="store_true", help="show the model without its residual")
    add_settings(parser, RenderSettings, "size", "samples", "seed")
    add(
        "--texel",
        type=texel,
        metavar="X,Y",
        help="texel of figure10, from the top left (default: the glossiest)",
    )
    add(
        "--view",
        type=view_angles,
        default="45,0",
        metavar="THETA,PHI",
        help="view direction of figure10 in degrees (default: %(default)s)",
    )
    add_source_options(parser)


def figure_lines() -> list[str]:
    """Every figure: its name and title."""
    from spmm_torch.figures import FIGURES

    return [f"{figure.name:<9} {figure.title}" for figure in FIGURES.values()]


def run(options: argparse.Namespace) -> list[str]:
    """Draws into a folder that appears whole or not at all."""
    check_source(options)
    check_place(options.output)
    from spmm_torch.edit.edits.residual_strength import residual_strength
    from spmm_torch.figures import Subject
    from spmm_torch.model.spmm import SPMM
    from spmm_torch.runtime.atomic import new_folder
    from spmm_torch.runtime.device import resolve_device
    from spmm_torch.runtime.progress import Progress

    wanted, choices, progress = _wanted(options.only), _choices(options), Progress()
    with new_folder(options.output) as folder:
        device = resolve_device(options.device)
        model = SPMM.load(options.run, device)
        if options.lobes_alone:
            model = residual_strength(model, 0.0)
        subject = Subject(model, lambda: load_source(options, progress), device, choices, progress)
        drawn = {each: each.draw(subject) for each in wanted}
        write_figures(folder, options.run, model.name, drawn)
    return [str(Path(options.output) / PAGE)]


def write_figures(folder: Path, run: str, name: str, drawn: dict[Figure, Drawing]) -> None:
    """The pictures, their numbers and their page."""
    from spmm_torch.render import write_png
    from spmm_torch.report.contract import json_text

    for each, drawing in drawn.items():
        write_png(folder / f"{each.name}.png", drawing.picture)
    values = {each.name: drawing.values for each, drawing in drawn.items()}
    (folder / VALUES).write_text(json_text({"run": run, **values}), encoding="utf-8")
    (folder / PAGE).write_text(figures_page(name, drawn), encoding="utf-8")


def figures_page(name: str, drawn: dict[Figure, Drawing]) -> str:
    """The text of a page of all figures with their captions."""
    from spmm_torch.report.html import render_template
    from spmm_torch.report.pictures import png_uri
    from spmm_torch.report.views import Picture

    pictures = [
        Picture(png_uri(drawing.picture), figure.title, drawing.caption)
        for figure, drawing in drawn.items()
    ]
    return render_template("figures.html.j2", {"name": name, "pictures": pictures})


def _choices(options: argparse.Namespace) -> Choices:
    from spmm_torch.figures import Choices

    picture = read_settings(RenderSettings, options)
    return Choices(picture.size, picture.samples, options.texel, options.view, picture.seed)


def _wanted(only: str | None) -> list[Figure]:
    from spmm_torch.figures import FIGURES

    names = list(FIGURES) if only is None else [name.strip() for name in only.split(",")]
    for name in names:
        if name not in FIGURES:
            raise ConfigError(f"--only names {name!r}; expected some of {', '.join(FIGURES)}.")
    return [FIGURES[name] for name in dict.fromkeys(names)]
