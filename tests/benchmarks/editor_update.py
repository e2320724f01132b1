"""Time of an update of the editor's picture, by kind of edit, on 256 x 256 texels of 8 lobes each.

An update is all that a moved slider costs on the server: the edit itself, the lobes that it
changed, the picture of 256 x 256 pixels, and its JPEG.

    python -m tests.benchmarks.editor_update [--size 256] [--texels 256] [--lobes 8] [--threads N]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch

from spmm_torch.cli.editor import leave_a_core
from spmm_torch.viz.editor.preview import Preview, jpeg_uri
from spmm_torch.viz.editor.session import Session
from spmm_torch.viz.editor.sliders import SLIDERS
from spmm_torch.viz.editor.stage import Setting
from tests.planted.models import planted_model

REPEATS = 9
CLUSTERS, LOBES_PER_CLUSTER = 32, 30
# Other things that a user moves, as settings of the stage.
MOVES = {"light": Setting(light=(30.0, 60.0)), "view": Setting(view=(20.0, 40.0))}


def main() -> None:
    """Prints a line for each slider of a flat material, and one each for the light and the view."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in (("size", 256), ("texels", 256), ("lobes", 8), ("threads", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    options = parser.parse_args()
    leave_a_core()  # as the editor does
    if options.threads:
        torch.set_num_threads(options.threads)
    model = planted_model(
        options.texels, options.lobes, CLUSTERS, LOBES_PER_CLUSTER, residual=0.01
    ).requires_grad_(False)
    usable = Session(Path(), model).usable()
    print(
        f"{model.height} x {model.width} texels of {options.lobes} lobes, "
        f"{options.size} x {options.size} pixels, {torch.get_num_threads()} threads"
    )
    print("edit                    median ms   slowest ms   median CPU ms")
    for slider in (slider for slider in SLIDERS if usable[slider.name]):
        session, preview = Session(Path(), model), Preview(model, Setting(), options.size)
        preview.follow(model)
        times = []
        for step in range(REPEATS):
            part = (step + 1) / (REPEATS + 1)
            session.move(slider.name, slider.neutral + part * (slider.high - slider.neutral))
            times.append(timed(lambda s=session, p=preview: jpeg_uri(p.follow(s.model()))))
        report(slider.title, times[1:])  # the first one makes what the others reuse
    for name, setting in MOVES.items():
        times = [timed(lambda s=setting: Preview(model, s, options.size)) for _ in "abc"]
        report(name, times)


def timed(action: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds that a call takes, by the clock and of the processor."""
    start, used = time.perf_counter(), time.process_time()
    action()
    return 1000.0 * (time.perf_counter() - start), 1000.0 * (time.process_time() - used)


def report(name: str, times: list[tuple[float, float]]) -> None:
    """One line; the clock tells less on a busy machine than the processor."""
    clock, used = zip(*times, strict=True)
    medians = statistics.median(clock), statistics.median(used)
    print(f"{name:<24}{medians[0]:9.1f}{max(clock):13.1f}{medians[1]:16.1f}", flush=True)


if __name__ == "__main__":
    main()
