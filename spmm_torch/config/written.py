"""YAML whose plain scalars stay as they were written, until the type of a setting is known.

YAML 1.1 reads 010 as 8, 1:30 as 90, and `off` as false. Here `Written` keeps the text, and
`schema.checked` reads it by the type that the setting has.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from ..errors import ConfigError
from ..runtime.names import path_of, text_of

# Plain scalars that stand for no value.
NULLS = ("", "~", "null", "Null", "NULL")
# Plain scalars that are true or false, in small letters.
BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
WHOLE = re.compile(r"[-+]?\d+")
NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
NOT_FINITE = re.compile(r"[-+]?\.?(nan|inf)", re.IGNORECASE)


class Written(str):
    """A value as it was written without quotes: a number, a word, or true or false."""

    __slots__ = ()

    def __repr__(self) -> str:
        """The text, in quotes if it is a word."""
        bare = NUMBER.fullmatch(self) or NOT_FINITE.fullmatch(self) or self.lower() in BOOLEANS
        return str(self) if bare else str.__repr__(self)

    def as_type(self, kind: type) -> Any:
        """The value that it stands for as an int, float, bool or str.

        Raises:
            ValueError: it stands for none.
        """
        text = str(self)
        if kind is str:
            return text
        if kind is bool and text.lower() in BOOLEANS:
            return BOOLEANS[text.lower()]
        if kind is int and WHOLE.fullmatch(text):
            return int(text)
        if kind is float and (NUMBER.fullmatch(text) or NOT_FINITE.fullmatch(text)):
            return float(text.replace(".nan", "nan").replace(".inf", "inf"))
        raise ValueError(text)


class _Loader(yaml.SafeLoader):
    """A loader that gives None for a plain null, `Written` for all other plain scalars."""

    def construct_written(self, node: yaml.ScalarNode) -> str | None:
        """The value of a scalar without a tag of its own."""
        if node.style is not None:
            return str(node.value)
        return None if node.value in NULLS else Written(node.value)

    def construct_once(self, node: yaml.MappingNode) -> dict[Any, Any]:
        """A mapping; of two equal keys the first would be lost without a word."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for number, key in enumerate(keys):
            if key in keys[:number]:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key} is there twice", node.value[number][0].start_mark
                )
        found = self.construct_mapping(node, deep=True)
        return {
            str(key) if isinstance(key, Written) else key: value for key, value in found.items()
        }


_Loader.yaml_implicit_resolvers = {}
_Loader.add_constructor("tag:yaml.org,2002:str", _Loader.construct_written)
_Loader.add_constructor("tag:yaml.org,2002:map", _Loader.construct_once)


def load_text(text: str) -> Any:
    """The content of a YAML text: None, `Written`, str, and lists and dicts of these.

    Raises:
        yaml.YAMLError: not valid YAML.
    """
    return yaml.load(text, _Loader)  # noqa: S506 - a SafeLoader


def load_yaml(path: Path | str, what: str = "settings file") -> Any:
    """The content of a YAML file, as `load_text` gives it; `what` names it in complaints.

    Its texts may be paths, and are spelled as this process spells these.

    Raises:
        ConfigError: no such file, or not valid YAML.
    """
    try:
        return with_texts(load_text(Path(path).read_text(encoding="utf-8")), path_of)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{what} {path} cannot be read ({error}); check it.") from error
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"{what} {path} is not valid YAML: {reason}; mend it.") from error


def dump_text(values: Any, *, unicode: bool) -> str:
    """The YAML text of plain values, whose texts may be paths as this process spells them.

    Args:
        values: nested lists, dictionaries and scalars.
        unicode: whether letters beyond ASCII stay as they are.
    """
    return yaml.safe_dump(with_texts(values, text_of), sort_keys=False, allow_unicode=unicode)


def with_texts(values: Any, change: Callable[[str], str]) -> Any:
    """Nested plain values with every text changed, keys apart."""
    if isinstance(values, dict):
        return {key: with_texts(item, change) for key, item in values.items()}
    if isinstance(values, list):
        return [with_texts(item, change) for item in values]
    return type(values)(change(values)) if isinstance(values, str) else values


def kind_of(values: Any) -> str:
    """What the content of a YAML file is, in the words of YAML."""
    names = {list: "a list", dict: "sections with keys", type(None): "nothing"}
    return names.get(type(values), "text")


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigError: no such file, not valid YAML, or not a mapping.
    """
    values = load_yaml(path)
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(
            f"settings file {path} holds {kind_of(values)}; expected sections as in "
            f"configs/default.yaml."
        )
    return values
