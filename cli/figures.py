"""The command `spmm figures`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from spmm_torch.cli.evaluate import add_source_options, load_source
from spmm_torch.cli.parser import Parser
from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.figures.catalogue import FIGURES
from spmm_torch.figures.figure import Choices, Drawing, Figure, Subject
from spmm_torch.model.spmm import SPMM
from spmm_torch.render import write_png
from spmm_torch.report.contract import json_text
from spmm_torch.report.html import render_template
from spmm_torch.report.pictures import png_uri
from spmm_torch.report.views import Picture
from spmm_torch.runtime.atomic import new_folder
from spmm_torch.runtime.device import resolve_device
from spmm_torch.runtime.progress import Progress

VALUES, PAGE = "figures.json", "figures.html"


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm figures`; returns the exit code."""
    try:
        options = parser().parse_args(arguments)
        draw_figures(options, Progress())
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(Path(options.output) / PAGE)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm figures`."""
    names = ", ".join(FIGURES)
    defaults = Choices()
    result = Parser(prog="spmm figures", description="Draw the figures of the paper for a run.")
    add = result.add_argument
    add("run", metavar="RUN", help="run folder")
    add("-o", "--output", required=True, metavar="OUT", help="folder to make")
    add("--only", metavar="NAME,...", help=f"some of {names} (default: all)")
    add("--size", type=int, default=defaults.size, help="pixels of a rendering (default: 256)")
    add("--samples", type=int, default=defaults.samples, help="eye rays of a pixel (default: 4)")
    add("--texel", metavar="X,Y", help="texel of figure10, from the top left (default: glossiest)")
    add("--view", metavar="THETA,PHI", default="45,0", help="its view in degrees (default: 45,0)")
    add("--seed", type=int, default=defaults.seed, help="of every random choice")
    add_source_options(add)
    return result


def draw_figures(options: argparse.Namespace, progress: Progress) -> None:
    """Draws as the command line asks, into a folder that appears whole or not at all."""
    wanted = _wanted(options.only)
    choices = Choices(
        options.size,
        options.samples,
        None if options.texel is None else _pair("texel", options.texel, int),
        tuple(math.radians(angle) for angle in _pair("view", options.view, float)),
        options.seed,
    )
    with new_folder(options.output) as folder:
        device = resolve_device(options.device)
        model = SPMM.load(options.run, device)
        subject = Subject(model, lambda: load_source(options, progress), device, choices, progress)
        drawn = {each: each.draw(subject) for each in wanted}
        for each, drawing in drawn.items():
            write_png(folder / f"{each.name}.png", drawing.picture)
        values = {each.name: drawing.values for each, drawing in drawn.items()}
        text = json_text({"run": str(options.run), **values})
        (folder / VALUES).write_text(text, encoding="utf-8")
        (folder / PAGE).write_text(figures_page(model.name, drawn), encoding="utf-8")


def figures_page(name: str, drawn: dict[Figure, Drawing]) -> str:
    """The text of a page of all figures with their captions."""
    pictures = [
        Picture(png_uri(drawing.picture), figure.title, drawing.caption)
        for figure, drawing in drawn.items()
    ]
    return render_template("figures.html.j2", {"name": name, "pictures": pictures})


def _wanted(only: str | None) -> list[Figure]:
    names = list(FIGURES) if only is None else [name.strip() for name in only.split(",")]
    for name in names:
        if name not in FIGURES:
            raise ConfigError(f"--only names {name!r}; expected some of {', '.join(FIGURES)}.")
    return [FIGURES[name] for name in dict.fromkeys(names)]


def _pair(name: str, text: str, kind: type) -> tuple:
    """Two numbers of an option."""
    try:
        first, second = (kind(word) for word in text.split(","))
        if not (math.isfinite(first) and math.isfinite(second)):
            raise ValueError
    except ValueError as error:
        raise ConfigError(f"--{name} is {text!r}; expected two numbers such as 12,30.") from error
    return first, second
