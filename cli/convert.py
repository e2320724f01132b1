"""Write a BTF in another format.

--gamma holds for the 8-bit pictures of INPUT and of OUT alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from spmm_torch.config.fit import DataConfig
from spmm_torch.config.schema import setting
from spmm_torch.errors import ConfigError, OutputError

from .inputs import decode
from .parser import Parser, add_output, file_name
from .settings import add_settings, read_settings

# Bytes of a number.
SCALARS = {"half": 2, "float": 4, "double": 8}
# A name without a suffix is a folder, of EXR pictures.
FORMAT_OF_SUFFIX = {".npz": "npz", ".zip": "ubo2003", ".btf": "btf", "": "exr"}
# What is counted while each format is written.
FORMATS = {"npz": "views", "ubo2003": "views", "exr": "views", "btf": "texels"}


@dataclass(frozen=True)
class WriteSettings:
    """How a BTF is written; each format heeds what concerns it."""

    png: bool = setting(False, "PNG pictures in a zip, which lose nothing, instead of JPEG")
    quality: int = setting(95, "quality of JPEG pictures in a zip", low=1, high=100)
    components: int = setting(100, "singular values that a .btf keeps of each channel", low=1)
    scalar: str = setting(
        "float", "type of the numbers in a .btf, of 2, 4 or 8 bytes", choices=tuple(SCALARS)
    )


def add_options(parser: Parser) -> None:
    """The options of `spmm convert`."""
    add = parser.add_argument
    add("input", type=file_name, metavar="INPUT", help="BTF of any format that spmm fit reads")
    add_output(
        parser,
        "OUT",
        "name to make: X.npz, X.zip (UBO2003), X.btf (UBO2014), or one without suffix (EXR folder)",
    )
    add("--format", choices=tuple(FORMATS), help="format of OUT (default: by the suffix of OUT)")
    add_settings(parser, DataConfig, "gamma", "cosine", "negative")
    add_settings(parser, WriteSettings)


def run(options: argparse.Namespace) -> list[str]:
    """Converts; the output is whole or not there at all."""
    from spmm_torch.data import load_input
    from spmm_torch.runtime.progress import Progress

    target = Path(options.output)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target} exists; expected a new name; choose one or remove it.")
    format = options.format or format_of(options.output)
    data, settings = read_settings(DataConfig, options), read_settings(WriteSettings, options)
    write, unit, progress = writer_of(format, data.gamma, settings), FORMATS[format], Progress()
    btf = load_input(options.input, data)
    decode(btf, progress)
    total = len(btf.view) if unit == "views" else btf.texel_count
    with progress.stage("write", total, unit) as stage:
        write(target, btf, progress=stage.to)
    return [str(target)]


def writer_of(format: str, gamma: float, settings: WriteSettings) -> Callable[..., None]:
    """The writer of a format, called with (path, btf, progress=...)."""
    from spmm_torch.data.ubo2014 import write_ubo2014
    from spmm_torch.data.writers import write_exr_folder, write_npz, write_ubo2003

    pictures, scalar = "png" if settings.png else "jpeg", SCALARS[settings.scalar]
    zip_settings = {"gamma": gamma, "format": pictures, "quality": settings.quality}
    return {
        "npz": write_npz,
        "ubo2003": partial(write_ubo2003, **zip_settings),
        "exr": write_exr_folder,
        "btf": partial(write_ubo2014, components=settings.components, scalar=scalar),
    }[format]


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
