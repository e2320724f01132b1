"""The file that a plug-in names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import ConfigError, OutputError
from ..runtime.names import path_of
from .libraries import mi


def given_name(properties: Any, key: str, plugin: str, names: Sequence[str]) -> str:
    """What a property says, one of some names; the first of them where there is none.

    Args:
        properties: of the plug-in.
        key: of the property.
        plugin: its name.
        names: that are possible.

    Raises:
        ConfigError: it is none of them.
    """
    given = properties[key] if key in properties else names[0]
    if given not in names:
        raise ConfigError(
            f"{key} of the bsdf {plugin} is {given!r}; expected {' or '.join(names)}; choose one."
        )
    return str(given)


def given_path(properties: Any, plugin: str, expected: str) -> Path:
    """The path under `filename`, found as Mitsuba finds files beside a scene.

    Args:
        properties: of the plug-in.
        plugin: its name.
        expected: what the file must be, in words.

    Raises:
        OutputError: there is no such property, or nothing lies there.
    """
    if "filename" not in properties:
        raise OutputError(
            f"the bsdf {plugin} has no filename; expected {expected}; add "
            f"<string name='filename' value='...'/>."
        )
    name = str(properties["filename"])
    path = Path(path_of(str(mi.file_resolver().resolve(name))))
    if not path.exists():
        raise OutputError(
            f"{path.absolute()} does not exist; expected {expected}; check the filename of the "
            f"bsdf {plugin}."
        )
    return path
