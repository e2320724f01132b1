"""Writer of UBO2014 `.btf` files, as an entry of the registry; see `data.ubo2014`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...config.schema import setting
from ..options import DEFAULT_COMPONENTS
from .base import Writer

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress

SCALAR_BYTES = {"half": 2, "float": 4, "double": 8}


@dataclass(frozen=True)
class Ubo2014Settings:
    """The options of a `.btf` file."""

    components: int = setting(
        DEFAULT_COMPONENTS, "number of singular values of each channel (.btf only)", low=1
    )
    scalar: str = setting(
        "float",
        "type of the stored numbers, of 2, 4 or 8 bytes (.btf only)",
        choices=tuple(SCALAR_BYTES),
    )


def write(
    path: Path | str, btf: BTF, settings: Ubo2014Settings, progress: Progress | None = None
) -> None:
    """Writes a BTF as a `.btf` file; see `write_ubo2014`."""
    from ..ubo2014.write import write_ubo2014

    scalar = SCALAR_BYTES[settings.scalar]
    write_ubo2014(path, btf, components=settings.components, scalar=scalar, progress=progress)


WRITER = Writer("btf", "UBO2014 file", ".btf", "texels", Ubo2014Settings, write)
