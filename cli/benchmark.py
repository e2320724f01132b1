"""Measure speed against error on this machine.

Compares settings and other methods, varies the size of the input, and holds
each stage against its limit. Leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spmm_torch.benchmark.repeats import FULL_REPEATS, SMALL_REPEATS
from spmm_torch.config.fit import DataConfig, FitConfig
from spmm_torch.errors import ConfigError

from .inputs import READING
from .parser import Parser, add_output, file_name, whole_number
from .settings import add_settings, read_settings

if TYPE_CHECKING:
    from types import ModuleType

    from spmm_torch.benchmark.scope import Bench, Scope

# The modules of `spmm_torch.benchmark` that measure something, in their order.
PARTS = ("sweep", "peers", "rates", "weightings", "scaling", "limits", "launches")
RESULTS, PAGE = "benchmark.json", "benchmark.html"
SCHEMA_VERSION = 1


def add_options(parser: Parser) -> None:
    """The options of `spmm benchmark`."""
    add = parser.add_argument
    add(
        "input",
        nargs="*",
        type=file_name,
        metavar="INPUT",
        help="BTF as for spmm fit (default: the bundled sample); of several the first is measured, "
        "and all of them by the part rates",
    )
    add_output(parser, "OUT", f"folder to make, with {RESULTS} and {PAGE}")
    add(
        "--parts",
        default=",".join(PARTS),
        metavar="NAME,...",
        help="parts of the benchmark (default: %(default)s)",
    )
    add("--small", action="store_true", help="measure for two minutes, to show that it runs")
    add(
        "--repeats",
        type=whole_number,
        metavar="N",
        help=f"runs of each measurement at most (default: {FULL_REPEATS}; {SMALL_REPEATS} with "
        f"--small)",
    )
    add(
        "--training",
        metavar="TIME,...",
        help="training times of the neural peers, in units of the time of our own fit; 0: none of "
        "them (default: 1,10)",
    )
    add_settings(parser, FitConfig, "device")
    add_settings(parser, DataConfig, *READING)


def run(options: argparse.Namespace) -> list[str]:
    """Measures, and writes the results whole or not at all."""
    from spmm_torch.benchmark.page import write_page
    from spmm_torch.benchmark.scope import Bench
    from spmm_torch.data import ReadOptions, sample_path
    from spmm_torch.runtime.atomic import new_folder
    from spmm_torch.runtime.device import resolve_device
    from spmm_torch.runtime.progress import Progress

    reading = ReadOptions.of(read_settings(DataConfig, options))
    parts, progress = chosen_parts(options.parts), Progress()
    scope = chosen_scope(options.small, options.repeats)
    device = resolve_device(options.device)
    source, *others = [Path(name) for name in options.input] or [sample_path()]
    scope = replace(scope, materials=tuple(others))
    if options.training is not None:
        scope = replace(scope, training=chosen_training(options.training))
    with new_folder(options.output) as folder:
        total = 1 + sum(part(name).count(scope) for name in parts)
        with progress.stage("benchmark", total, "measurements") as stage:
            results = measure(Bench(source, scope, device, progress, stage, reading), parts)
        text = json.dumps(finite(results), indent=1, ensure_ascii=False, allow_nan=False)
        (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
        write_page(folder / PAGE, results)
    return [*headlines(results), str(Path(options.output) / PAGE)]


def part(name: str) -> ModuleType:
    """The module of a part."""
    return import_module(f"spmm_torch.benchmark.{name}")


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
    from spmm_torch.benchmark.scope import FULL, SMALL

    scope = SMALL if small else FULL
    if repeats is None:
        return scope
    if repeats < 1:
        raise ConfigError(f"--repeats is {repeats}; expected 1 or more.")
    return replace(scope, protocol=replace(scope.protocol, repeats=repeats))


def chosen_training(text: str) -> tuple[float, ...]:
    """The training times that a list names; those of zero are none.

    Raises:
        ConfigError: something that is no time.
    """
    try:
        times = [float(part) for part in text.split(",")]
    except ValueError:
        times = [math.nan]
    if not all(0.0 <= time < math.inf for time in times):
        raise ConfigError(
            f"--training is {text!r}; expected positive numbers with commas between them, or 0."
        )
    return tuple(time for time in times if time > 0.0)


def measure(bench: Bench, parts: list[str]) -> dict[str, Any]:
    """The results of some parts, as the docstring of `spmm_torch.benchmark` describes them."""
    from spmm_torch.benchmark.environment import environment
    from spmm_torch.benchmark.fits import on_device, plain_fit, timed_fit
    from spmm_torch.benchmark.scope import WARM_UP
    from spmm_torch.benchmark.variants import DEFAULT
    from spmm_torch.config.shipped import shipped

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
    return results | {name: part(name).run(bench, default) for name in parts}


def finite(value: Any) -> Any:
    """JSON has no infinity: what is not finite becomes null."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def headlines(results: dict[str, Any]) -> list[str]:
    """What a person wants to know at once: leads of peers, exponents and fractions."""
    lines = []
    for lead in results.get("rates", {}).get("leads", []):
        if lead["cost"] == "bytes_per_texel" and lead["quality"] == "snr_db" and lead["lead"]:
            lines.append(
                f"{lead['material']}: {lead['curve']} is ahead by up to {lead['lead']:.2f} dB from "
                f"{lead['first']:.1f} bytes a texel"
            )
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
    for row in results.get("launches", {}).get("rows", [])[-1:]:
        lines.append(
            f"a GPU would be asked for {row['launches']:,} operations, {row['seconds']:.2f} s to "
            f"launch, and the host would wait {row['waits']:,} times"
        )
    return lines
