"""The command `spmm benchmark`."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from spmm_torch.benchmark import limits, peers, scaling, sweep, weightings
from spmm_torch.benchmark.environment import environment
from spmm_torch.benchmark.fits import on_device, plain_fit, timed_fit
from spmm_torch.benchmark.page import write_page
from spmm_torch.benchmark.scope import FULL, SMALL, WARM_UP, Bench, Scope
from spmm_torch.benchmark.variants import DEFAULT, shipped
from spmm_torch.cli.parser import STOPPED
from spmm_torch.data import sample_path
from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.runtime.atomic import new_folder
from spmm_torch.runtime.device import resolve_device
from spmm_torch.runtime.progress import Progress

PARTS: dict[str, ModuleType] = {
    "sweep": sweep,
    "peers": peers,
    "weightings": weightings,
    "scaling": scaling,
    "limits": limits,
}
RESULTS, PAGE = "benchmark.json", "benchmark.html"
SCHEMA_VERSION = 1


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm benchmark`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        results = run_files(options, Progress())
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; nothing was written.", file=sys.stderr)
        return STOPPED
    for line in headlines(results):
        print(line)
    print(Path(options.output) / PAGE)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm benchmark`."""
    result = argparse.ArgumentParser(
        prog="spmm benchmark",
        description="Measure speed against error: our own settings, other methods, scaling, and "
        "each stage against its limit. Leave the machine alone meanwhile.",
    )
    add = result.add_argument
    add("input", nargs="?", help="a BTF as for spmm fit (default: the bundled sample)")
    add("-o", "--output", required=True, metavar="OUT", help=f"folder for {RESULTS} and {PAGE}")
    add("--parts", default=",".join(PARTS), help="some of them (default: %(default)s)")
    add("--small", action="store_true", help="about a minute: shows that it runs, no more")
    add("--repeats", type=int, metavar="N", help=f"at most (default: {FULL.protocol.repeats})")
    add("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    return result


def run_files(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Measures what the command line asks for, and writes it whole or not at all."""
    parts = chosen_parts(options.parts)
    scope = chosen_scope(options.small, options.repeats)
    device = resolve_device(options.device)
    source = Path(options.input) if options.input else sample_path()
    with new_folder(options.output) as folder:
        total = 1 + sum(PARTS[name].count(scope) for name in parts)
        with progress.stage("benchmark", total, "measurements") as stage:
            results = run(Bench(source, scope, device, progress, stage), parts)
        text = json.dumps(finite(results), indent=1, ensure_ascii=False, allow_nan=False)
        (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
        write_page(folder / PAGE, results)
    return results


def chosen_parts(text: str) -> list[str]:
    """The parts that a list names, in their own order.

    Raises:
        ConfigError: an unknown part.
    """
    asked = [name.strip() for name in text.split(",")]
    if unknown := [name for name in asked if name not in PARTS]:
        raise ConfigError(
            f"--parts names {unknown[0]!r}; expected some of {', '.join(PARTS)}, with commas "
            f"between them."
        )
    return [name for name in PARTS if name in asked]


def chosen_scope(small: bool, repeats: int | None) -> Scope:
    """How much to measure.

    Raises:
        ConfigError: fewer than one repeat.
    """
    scope = SMALL if small else FULL
    if repeats is None:
        return scope
    if repeats < 1:
        raise ConfigError(f"--repeats is {repeats}; expected 1 or more.")
    return replace(scope, protocol=replace(scope.protocol, repeats=repeats))


def run(bench: Bench, parts: list[str]) -> dict[str, Any]:
    """The results of some parts, as the docstring of the package describes them."""
    scope = bench.scope
    config = on_device(shipped(DEFAULT, scope.overrides), bench.device)
    warm = bench.with_selection(WARM_UP)
    plain_fit(warm.open(), config)  # what is imported and allocated once must not count
    default = timed_fit(bench, config)
    bench.advance()
    btf = bench.open()
    results: dict[str, Any] = {
        "version": SCHEMA_VERSION,
        "environment": environment(bench.device),
        "input": {
            "path": str(bench.source),
            "texels": btf.texel_count,
            "direction_pairs": btf.pair_count,
            "channels": btf.channels,
            "raw_bytes": btf.raw_bytes,
        },
        "protocol": {
            "repeats": scope.protocol.repeats,
            "patience_seconds": scope.protocol.patience,
            "overrides": list(scope.overrides),
        },
        "default": default.row(),
    }
    return results | {name: PARTS[name].run(bench, default) for name in parts}


def finite(value: Any) -> Any:
    """JSON has no infinity: what is not finite becomes null."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def headlines(results: dict[str, Any]) -> list[str]:
    """What a person wants to know at once: exponents and fractions."""
    lines = []
    for row in results.get("scaling", {}).get("exponents", []):
        power = row["power"]["total"]
        shown = "too fast to tell" if power is None else f"{power:.2f}"
        lines.append(
            f"time grows with {row['varies']} to the power {shown} "
            f"({row['device']}, {row['threads']} threads)"
        )
    for row in results.get("limits", {}).get("rows", []):
        if row["fraction"] is not None:
            lines.append(f"{row['stage']}: {100.0 * row['fraction']:.0f} % of its limit")
    return lines
