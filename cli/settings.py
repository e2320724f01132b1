"""Settings as options: name, type, default, range and meaning are those of the dataclass."""

from __future__ import annotations

import argparse
import shutil
import textwrap
import typing
from dataclasses import Field, fields
from typing import Any, TypeVar, cast

import yaml

from spmm_torch.config.schema import REQUIRED, allowed, checked, describe, plain
from spmm_torch.config.written import Written

from .parser import Group

S = TypeVar("S")

# What the value of an option is called, where it is not a word.
METAVARS: dict[type, str] = {int: "N", float: "X"}
MIN_WIDTH, MAX_WIDTH = 24, 100


def add_settings(parser: Group, cls: type, *names: str) -> None:
    """An option for each of these settings, for all if none is named."""
    hints = typing.get_type_hints(cls)
    for item in fields(cls):
        if not names or item.name in names:
            add_setting(parser, item, hints[item.name])


def add_setting(parser: Group, item: Field[Any], kind: type) -> None:
    """The option of one setting: a number, a word, or a switch that is off by default."""
    option, meaning = option_name(item.name), item.metadata["meaning"]
    if kind is bool:
        parser.add_argument(option, action="store_true", help=escaped(of_switch(meaning)))
        return
    kind = next((each for each in typing.get_args(kind) if each is not type(None)), kind)
    choices = item.metadata["choices"]
    span = "" if choices else allowed(item.metadata)
    default = "null" if item.default is None else item.default
    parser.add_argument(
        option,
        type=Written if kind in METAVARS and not choices else kind,
        default=item.default,
        choices=choices,
        metavar=None if choices else METAVARS.get(kind, item.name.upper()),
        help=escaped(f"{'; '.join(filter(None, [meaning, span]))} (default: {default})"),
    )


def of_switch(meaning: str) -> str:
    """The meaning of a setting that is true or false, for an option that makes it true."""
    return meaning.removeprefix("whether ").removeprefix("to ")


def option_name(name: str) -> str:
    """The option of a setting."""
    return f"--{name.replace('_', '-')}"


def escaped(text: str) -> str:
    """A help text that argparse is to print as it is."""
    return text.replace("%", "%%")


def read_settings(cls: type[S], options: argparse.Namespace) -> S:
    """The settings that a command line gives; what it does not give keeps its default.

    Raises:
        ConfigError: a value out of its range; the sentence names the option.
    """
    hints, given = typing.get_type_hints(cls), {}
    for item in fields(cast(Any, cls)):
        value = getattr(options, item.name, None)
        if value is not None:
            where = option_name(item.name)
            given[item.name] = checked(value, hints[item.name], item.metadata, where)
    return cls(**given)


def settings_lines(cls: type, indent: int = 2) -> list[str]:
    """Every setting of a dataclass for a help text: key, default, range, and meaning below."""
    lines = []
    for key, default, meaning, span in describe(cls):
        head = f"{key}, required" if default is REQUIRED else f"{key} = {in_yaml(default)}"
        lines += wrapped(f"{head}   ({span})" if span else head, indent, indent + 4)
        lines += wrapped(meaning, indent + 4, indent + 4)
    return lines


def wrapped(text: str, first: int, rest: int) -> list[str]:
    """A text in lines that fit the terminal, indented by `first` and then `rest` columns."""
    width = max(MIN_WIDTH, min(shutil.get_terminal_size().columns - 2, MAX_WIDTH))
    return textwrap.wrap(text, width, initial_indent=" " * first, subsequent_indent=" " * rest)


def in_yaml(value: Any) -> str:
    """A value as it stands in a settings file, on one line."""
    text = yaml.safe_dump(plain(value), default_flow_style=True, width=float("inf"))
    return text.removesuffix("...\n").rstrip()
