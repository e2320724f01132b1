"""The interface of a target: what an export is called, and what of a model it can hold."""

from __future__ import annotations

import typing
from dataclasses import Field, dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..model.spmm import SPMM
    from ..render import Material
    from ..runtime.progress import Progress

LOBES, RESIDUAL, RELIEF = "lobes", "residual", "relief"
# What a model may have, and what is gone where a target cannot hold it.
PARTS = {
    LOBES: "the lobes of each texel; one layered surface is fit to them",
    RESIDUAL: "the residual; what is left are the lobes alone",
    RELIEF: "the relief; views see the texture in its plane",
}


@dataclass(frozen=True)
class NoSettings:
    """The options of a target without options."""


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        material: evaluates what was written, as its readers do: a function of uv `[..., 2]`, wi
            and wo `[..., 3]` to cosine-weighted RGB `[..., 3]`.
        notes: what else was lost, such as lobes beyond a count, one clause each.
    """

    material: Material
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """A program or format that models are exported to.

    Its function `write(place, model, settings, progress) -> Exported` is in the module of its
    name beside this one, which is imported once it is needed.

    Attributes:
        name: on the command line, and of the module.
        title: what is made, on one line.
        suffix: of the file, in lower case; empty for a folder.
        holds: which of `PARTS` it holds.
        settings: dataclass of `config.schema.setting` fields, the options of the target.
    """

    name: str
    title: str
    suffix: str
    holds: tuple[str, ...]
    settings: type = NoSettings

    def setting(self, name: str) -> tuple[Field[Any], Any]:
        """One of its settings and the type of that."""
        item = next(item for item in fields(self.settings) if item.name == name)
        return item, typing.get_type_hints(self.settings)[name]

    def write(self, place: Path, model: SPMM, settings: Any, progress: Progress) -> Exported:
        """Writes a model of three channels.

        Args:
            place: temporary name of the file, or an empty folder.
            model: on the device of the computation.
            settings: of the target's own class.
            progress: of the command.

        Raises:
            SPMMError: what the target needs is missing, or it cannot hold the model at all.
        """
        return import_module(f".{self.name}", __package__).write(place, model, settings, progress)
