"""Dr.Jit and Mitsuba, imported at first use: `mi` is always the variant that is set."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class _Library:
    """A package whose names are looked up when they are used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self._name), attribute)


dr: Any = _Library("drjit")
mi: Any = _Library("mitsuba")
