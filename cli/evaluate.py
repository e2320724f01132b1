"""Judge the saved model of a run against its input.

Writes evaluation.json and evaluation.html: errors by angle, texel and
direction pair, similarity of sphere pictures, and errors at directions that
the fit did not see.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .parser import Parser, add_output, add_run
from .source import add_source_options, check_source, load_source

if TYPE_CHECKING:
    from spmm_torch.evaluate import Judgement

FIGURES, PAGE = "evaluation.json", "evaluation.html"
# A saved model whose figures are further than this, in decibels, from what its fit reported is
# not the model, or not the input, of that fit.
SAME_DECIBELS = 0.01


def add_options(parser: Parser) -> None:
    """The options of `spmm evaluate`."""
    add_run(parser)
    add_output(parser, "OUT", "folder to make (default: write into RUN)", required=False)
    add_source_options(parser)


def run(options: argparse.Namespace) -> list[str]:
    """Judges, and writes both files whole or not at all."""
    check_source(options)
    from spmm_torch.evaluate import judge
    from spmm_torch.evaluate.page import evaluation_page
    from spmm_torch.report.contract import json_text
    from spmm_torch.runtime.atomic import new_file
    from spmm_torch.runtime.device import full_precision, resolve_device
    from spmm_torch.runtime.progress import Progress

    progress = Progress()
    with _output(options.output, options.run) as folder, full_precision():
        device = resolve_device(options.device)
        found = judge(load_source(options, progress), device, progress)
        for name, text in ((FIGURES, json_text(found.figures)), (PAGE, evaluation_page(found))):
            with new_file(folder / name) as temporary:
                temporary.write_text(text, encoding="utf-8")
    progress.say(headline(found))
    return [str(Path(options.output or options.run) / PAGE)]


def headline(found: Judgement) -> str:
    """The result in three lines, or four if the report of the fit says something else."""
    from spmm_torch.report.summary import picture_lines

    figures, difference = found.figures, found.figures["report_difference_db"]
    snr = figures["snr_db"]
    line = (
        f"SNR {snr['without_residual']:.2f} dB without residual, {snr['with_residual']:.2f} dB "
        f"with it"
    )
    if figures["mssim"]["mean"] is not None:
        line += f", MSSIM {figures['mssim']['mean']:.3f}"
    if figures["held_out"] is not None:
        line += f", held-out SNR {figures['held_out']['snr_db']['with_residual']:.2f} dB"
    line = "\n".join([line, *picture_lines(found.slices.sharpness, found.slices.display)])
    if difference is not None and difference > SAME_DECIBELS:
        line += (
            f"\nwarning: these differ from report.json by up to {difference:.2f} dB; the model or "
            f"the input is not what the fit had."
        )
    return line


@contextmanager
def _output(output: str | None, run: str) -> Iterator[Path]:
    """The folder to write into: a new one that appears at the end, or that of the run."""
    from spmm_torch.runtime.atomic import new_folder

    if output is None:
        yield Path(run)
        return
    with new_folder(output) as folder:
        yield folder
