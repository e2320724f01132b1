"""The command `spmm evaluate`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from spmm_torch.cli.parser import Parser
from spmm_torch.errors import SPMMError
from spmm_torch.evaluate.judge import Judgement, judge
from spmm_torch.evaluate.page import evaluation_page
from spmm_torch.evaluate.source import Source, open_source
from spmm_torch.report.contract import json_text
from spmm_torch.runtime.atomic import new_file, new_folder
from spmm_torch.runtime.device import full_precision, resolve_device
from spmm_torch.runtime.memory import DEFAULT_SHARE, free_memory
from spmm_torch.runtime.progress import Progress

FIGURES, PAGE = "evaluation.json", "evaluation.html"
# A saved model whose figures are further than this, in decibels, from what its fit reported is
# not the model, or not the input, of that fit.
SAME_DECIBELS = 0.01


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm evaluate`; returns the exit code."""
    try:
        options = parser().parse_args(arguments)
        progress = Progress()
        found = evaluate(options, progress)
        progress.say(headline(found))
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(Path(options.output or options.run) / PAGE)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm evaluate`."""
    result = Parser(
        prog="spmm evaluate", description="Judge the saved model of a run against its input."
    )
    add = result.add_argument
    add("run", metavar="RUN", help="run folder")
    add("-o", "--output", metavar="OUT", help="folder to make (default: write into RUN)")
    add_source_options(add)
    return result


def add_source_options(add: Callable[..., object]) -> None:
    """The options that tell where the input of a run is, and how it is to be read."""
    add("--against", metavar="INPUT", help="judge against this BTF (default: the input of RUN)")
    add("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    add("--cache", metavar="FOLDER", help="keep decoded values of INPUT here, for later calls too")


def evaluate(options: argparse.Namespace, progress: Progress) -> Judgement:
    """Evaluates as the command line asks, and writes both files whole or not at all."""
    with _output(options.output, options.run) as folder, full_precision():
        device = resolve_device(options.device)
        source = load_source(options, progress)
        found = judge(source, device, progress)
        page = evaluation_page(found)
        for name, text in ((FIGURES, json_text(found.figures)), (PAGE, page)):
            with new_file(folder / name) as temporary:
                temporary.write_text(text, encoding="utf-8")
    return found


def load_source(options: argparse.Namespace, progress: Progress) -> Source:
    """The run and its input, decoded."""
    source = open_source(options.run, options.against, resolve_device(options.device))
    cache = Path(options.cache) if options.cache else None
    with progress.stage("load", len(source.btf.view), "views") as stage:
        source.btf.load(stage.to, memory=int(DEFAULT_SHARE * free_memory()), cache=cache)
    return source


def headline(found: Judgement) -> str:
    """The result in one line, or two if the report of the fit says something else."""
    figures, difference = found.figures, found.figures["report_difference_db"]
    snr = figures["snr_db"]
    line = (
        f"SNR {snr['without_residual']:.2f} dB without residual, {snr['with_residual']:.2f} dB "
        f"with it, MSSIM {figures['mssim']['mean']:.3f}"
    )
    if figures["held_out"] is not None:
        line += f", held-out SNR {figures['held_out']['snr_db']['with_residual']:.2f} dB"
    if difference is not None and difference > SAME_DECIBELS:
        line += (
            f"\nwarning: these differ from report.json by up to {difference:.2f} dB; the model or "
            f"the input is not what the fit had."
        )
    return line


@contextmanager
def _output(output: str | None, run: str) -> Iterator[Path]:
    """The folder to write into: a new one that appears at the end, or that of the run."""
    if output is None:
        yield Path(run)
        return
    with new_folder(output) as folder:
        yield folder
