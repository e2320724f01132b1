"""The file that a plug-in names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import OutputError
from .libraries import mi


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
    path = Path(str(mi.file_resolver().resolve(name)))
    if not path.exists():
        raise OutputError(
            f"{path.absolute()} does not exist; expected {expected}; check the filename of the "
            f"bsdf {plugin}."
        )
    return path
