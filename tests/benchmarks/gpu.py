"""What a GPU does with all of it, in six minutes: `python -m tests.benchmarks.gpu -o OUT`.

It needs the checkout, torch and a few packages, no installation and no network. `OUT/gpu.json`
holds every figure, standard output one table of them. Each part is a process of its own with a
limit of time, so a part that fails or hangs costs the others nothing. `--device cpu` is a dry run;
`--small` makes everything small.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.benchmarks.on_gpu.child import Ended, run_child, stop
from tests.benchmarks.on_gpu.needs import missing
from tests.benchmarks.on_gpu.schedule import LIMITS, seconds_for

RESULTS = "gpu.json"
FAILED, BAD_INPUT = 1, 2


def chosen_parts(text: str) -> list[str]:
    """The parts that a list names, in their own order.

    Raises:
        SystemExit: an unknown part.
    """
    asked = [name.strip() for name in text.split(",")]
    if unknown := [name for name in asked if name not in LIMITS]:
        raise SystemExit(f"--parts names {unknown[0]!r}; expected some of {', '.join(LIMITS)}.")
    return [name for name in LIMITS if name in asked]


def measure(parts: list[str], device: str, small: bool) -> dict[str, Ended]:
    """How each part ended, and the rows that it measured."""
    start, ended = time.monotonic(), {}
    for number, part in enumerate(parts):
        limit = seconds_for(parts[number:], time.monotonic() - start)
        print(f"{part} ({limit:.0f} s at most) ...", file=sys.stderr, flush=True)
        ended[part] = run_child([part, device, "small" if small else "full"], limit)
    return ended


def written(about: dict[str, Any], ended: dict[str, Ended]) -> str:
    """What `gpu.json` holds."""
    from spmm_torch.cli.benchmark import finite

    results = finite({**about, "parts": {part: asdict(end) for part, end in ended.items()}})
    return json.dumps(results, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Measures, prints the table, writes the results whole; 1 where a part failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help="folder to make")
    parser.add_argument("--device", default="cuda", choices=("cuda", "cpu"), help="cpu: a dry run")
    parser.add_argument("--parts", default=",".join(LIMITS), metavar="NAME,...")
    parser.add_argument("--small", action="store_true", help="show that it runs")
    options = parser.parse_args(arguments)
    if sentence := missing(options.device):
        print(sentence, file=sys.stderr)
        return BAD_INPUT
    from spmm_torch.benchmark.environment import environment
    from spmm_torch.errors import SPMMError
    from spmm_torch.runtime.atomic import new_folder
    from spmm_torch.runtime.device import resolve_device
    from tests.benchmarks.on_gpu.table import table

    parts, device = chosen_parts(options.parts), options.device
    # Asked before anything can break the device.
    machine = environment(resolve_device(device))
    try:
        with new_folder(options.output) as folder:
            ended = measure(parts, device, options.small)
            about = {"environment": machine, "device": device, "small": options.small}
            (folder / RESULTS).write_text(written(about, ended), encoding="utf-8")
    except SPMMError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    print(table(machine, ended))
    print(Path(options.output) / RESULTS)
    return FAILED if any(found.failure for found in ended.values()) else 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, stop)  # ends the part that runs, too
    sys.exit(main())
