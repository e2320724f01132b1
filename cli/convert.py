"""The command `spmm convert`: any BTF that can be read, written in another format."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from spmm_torch.data import BTF, load_btf
from spmm_torch.data.options import DISPLAY_GAMMA, NEGATIVES
from spmm_torch.data.store import Progress as Report
from spmm_torch.data.ubo2014.write import DEFAULT_COMPONENTS, write_ubo2014
from spmm_torch.data.writers import write_exr_folder, write_npz, write_ubo2003
from spmm_torch.data.writers.ubo2003 import QUALITY
from spmm_torch.errors import ConfigError, OutputError, SPMMError
from spmm_torch.runtime.memory import DEFAULT_SHARE, free_memory
from spmm_torch.runtime.progress import Progress

Writer = Callable[[Path, BTF, argparse.Namespace, Report], None]

SCALAR_BYTES = {"half": 2, "float": 4, "double": 8}
# A name without a suffix is a folder, of EXR pictures.
FORMAT_OF_SUFFIX = {".npz": "npz", ".zip": "ubo2003", ".btf": "btf", "": "exr"}


def _npz(path: Path, btf: BTF, options: argparse.Namespace, report: Report) -> None:
    write_npz(path, btf, progress=report)


def _ubo2003(path: Path, btf: BTF, options: argparse.Namespace, report: Report) -> None:
    pictures = "png" if options.png else "jpeg"
    write_ubo2003(path, btf, options.gamma, pictures, options.quality, progress=report)


def _exr(path: Path, btf: BTF, options: argparse.Namespace, report: Report) -> None:
    write_exr_folder(path, btf, progress=report)


def _btf(path: Path, btf: BTF, options: argparse.Namespace, report: Report) -> None:
    scalar = SCALAR_BYTES[options.scalar]
    write_ubo2014(path, btf, components=options.components, scalar=scalar, progress=report)


# What is counted while it is written, and who writes it.
WRITERS: dict[str, tuple[str, Writer]] = {
    "npz": ("views", _npz),
    "ubo2003": ("views", _ubo2003),
    "exr": ("views", _exr),
    "btf": ("texels", _btf),
}


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm convert`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        output = convert(options)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(output)
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm convert`."""
    result = argparse.ArgumentParser(
        prog="spmm convert", description="Write a BTF in another format."
    )
    result.add_argument("input", help="BTF of any format that `spmm fit` reads")
    result.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="X.npz, X.zip (UBO2003), X.btf (UBO2014), or a name without suffix (EXR folder)",
    )
    result.add_argument("--format", choices=list(WRITERS), help="default: by the suffix of OUT")
    result.add_argument(
        "--gamma",
        type=float,
        default=DISPLAY_GAMMA,
        help="exponent that makes 8-bit codes linear, of INPUT and of OUT (default: %(default)s)",
    )
    result.add_argument(
        "--negative",
        choices=NEGATIVES,
        default="refuse",
        help="values of INPUT below zero: refuse, clip to zero, or keep (default: %(default)s)",
    )
    result.add_argument("--png", action="store_true", help="UBO2003 zip: PNG instead of JPEG")
    result.add_argument(
        "--quality", type=int, default=QUALITY, help="UBO2003 zip: of JPEGs (default: %(default)s)"
    )
    result.add_argument(
        "--components",
        type=int,
        default=DEFAULT_COMPONENTS,
        help=".btf: singular values kept for each channel (default: %(default)s)",
    )
    result.add_argument(
        "--scalar",
        choices=list(SCALAR_BYTES),
        default="float",
        help=".btf: how numbers are stored (default: %(default)s)",
    )
    return result


def convert(options: argparse.Namespace) -> Path:
    """Converts as the command line asks; the output is whole or not there at all."""
    target = Path(options.output)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target} exists; expected a new name; choose one or remove it.")
    unit, write = WRITERS[options.format or format_of(options.output)]
    progress = Progress()
    btf = load_btf(options.input, gamma=options.gamma, negative=options.negative)
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_SHARE * free_memory()))
    total = len(btf.view) if unit == "views" else btf.texel_count
    with progress.stage("write", total, unit) as stage:
        write(target, btf, options, stage.to)
    return target


def format_of(output: str) -> str:
    """The format that the name of an output asks for.

    Raises:
        ConfigError: its suffix belongs to no format.
    """
    suffix = "" if output.endswith("/") else Path(output).suffix.lower()
    if suffix not in FORMAT_OF_SUFFIX:
        raise ConfigError(
            f"output {output} ends in {suffix}, which names no format; expected .npz, .zip, .btf "
            f"or no suffix for a folder; choose another name or give --format."
        )
    return FORMAT_OF_SUFFIX[suffix]


if __name__ == "__main__":
    sys.exit(main())
