"""Write a BTF in another format.

--gamma holds for the 8-bit pictures of INPUT and of OUT alike, --rows for
INPUT. Where OUT cannot hold all, a line first says what is lost.
"""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from spmm_torch.config.fit import DataConfig
from spmm_torch.data.writers import WRITERS, Writer, writer_of
from spmm_torch.errors import ConfigError, OutputError

from .inputs import decode
from .parser import Parser, add_output, file_name
from .settings import add_settings, option_name, read_settings

READING = ("gamma", "cosine", "negative", "pattern", "rings", "rows")


def add_options(parser: Parser) -> None:
    """The options of `spmm convert`."""
    add = parser.add_argument
    add("input", type=file_name, metavar="INPUT", help="BTF of any format that spmm fit reads")
    names = (f"X{writer.suffix} ({writer.title})" for writer in WRITERS.values())
    add_output(parser, "OUT", f"name to make: {', '.join(names)}")
    add("--format", choices=tuple(WRITERS), help="format of OUT (default: by the suffix of OUT)")
    add_settings(parser, DataConfig, *READING)
    for writer in WRITERS.values():
        own = [item.name for item in fields(writer.settings) if item.name not in READING]
        if own:
            group = parser.add_argument_group(f"options of --format {writer.name}")
            add_settings(group, writer.settings, *own)


def run(options: argparse.Namespace) -> list[str]:
    """Converts; the output is whole or not there at all."""
    from spmm_torch.data import load_input
    from spmm_torch.runtime.progress import Progress

    target, progress = Path(options.output), Progress()
    if target.exists() or target.is_symlink():
        raise OutputError(f"{target} exists; expected a new name; choose one or remove it.")
    writer = writer_for(options.output, options.format)
    refuse_options_of_others(writer, options)
    settings = read_settings(writer.settings, options)
    btf = load_input(options.input, read_settings(DataConfig, options))
    decode(btf, progress)
    total = len(btf.view) if writer.unit == "views" else btf.texel_count
    if writer.prepare is None:
        with progress.stage("write", total, writer.unit) as stage:
            writer.write(target, btf, settings, stage.to)
        return [str(target)]
    with progress.stage("prepare", total, writer.unit) as stage:
        prepared = writer.prepare(btf, settings, stage.to)
    progress.say(prepared.loss)
    with progress.stage("write"):
        prepared.write(target)
    return [str(target)]


def refuse_options_of_others(writer: Writer, options: argparse.Namespace) -> None:
    """Refuses options that mean nothing to the format of the output.

    Raises:
        ConfigError: one was given that only another format has.
    """
    own = {*READING, *(item.name for item in fields(writer.settings))}
    for other in WRITERS.values():
        for item in fields(other.settings):
            if item.name not in own and getattr(options, item.name) != item.default:
                raise ConfigError(
                    f"{option_name(item.name)} is an option of --format {other.name}, and OUT is "
                    f"{writer.name}; expected options of that format; leave it out or change OUT."
                )


def writer_for(output: str, name: str | None) -> Writer:
    """The writer of a format; without its name, by the suffix of the output.

    Raises:
        ConfigError: the suffix belongs to no format, or to another one than the named.
    """
    if name is None:
        return writer_of(output)
    writer, suffix = WRITERS[name], Path(output).suffix.lower()
    others = [other.suffix for other in WRITERS.values() if other.suffix]
    if suffix != writer.suffix and suffix in others:
        kind = f"a name in {writer.suffix}" if writer.suffix else "a folder, without a suffix"
        raise ConfigError(
            f"output {output} does not fit --format {name}; expected {kind}; change one of them."
        )
    return writer
