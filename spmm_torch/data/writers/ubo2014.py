"""Writer of UBO2014 `.btf` files, as an entry of the registry; see `data.ubo2014`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...config.schema import setting
from ..options import DEFAULT_COMPONENTS
from .base import Prepared, Writer

if TYPE_CHECKING:
    from ..btf import BTF
    from ..store import Progress
    from ..ubo2014.truncate import Truncated

SCALAR_BYTES = {"half": 2, "float": 4, "double": 8}


@dataclass(frozen=True)
class Ubo2014Settings:
    """The options of a `.btf` file."""

    components: int | None = setting(
        None,
        f"number of singular values of each channel (.btf only); null: {DEFAULT_COMPONENTS}, or as "
        f"many as --snr needs",
        low=1,
    )
    snr: float | None = setting(
        None,
        "signal-to-noise ratio in dB to reach with the fewest components (.btf only); null: as "
        "--components says",
        low=0.0,
    )
    scalar: str = setting(
        "float",
        "type of the stored numbers, of 2, 4 or 8 bytes (.btf only)",
        choices=tuple(SCALAR_BYTES),
    )
    write_rows: str = setting(
        "top",
        "row of the pictures to store first (.btf only): top, as the library of the format's "
        "authors reads, or bottom, as btf.hh and BTF_extractor do",
        choices=("top", "bottom"),
    )


def prepare(btf: BTF, settings: Ubo2014Settings, progress: Progress | None = None) -> Prepared:
    """Factors a BTF; what they leave out is then known, before anything is written."""
    from ..ubo2014.truncate import truncate

    found = truncate(
        btf,
        components=settings.components,
        snr=settings.snr,
        scalar=SCALAR_BYTES[settings.scalar],
        rows=settings.write_rows,
        progress=progress,
    )
    return Prepared(loss_line(found), found.write)


def loss_line(found: Truncated) -> str:
    """What a reader of the file will miss, in one line."""
    line = (
        f"the file keeps {found.components} components of each channel: SNR {found.snr_db:.1f} dB, "
        f"more where a reader clips values below zero"
    )
    if not found.header.cosine:
        return line
    return f"{line}; values keep the cosine of the light, as a light is at the horizon"


def write(
    path: Path | str, btf: BTF, settings: Ubo2014Settings, progress: Progress | None = None
) -> None:
    """Writes a BTF as a `.btf` file; see `ubo2014.truncate`."""
    prepare(btf, settings, progress).write(path)


WRITER = Writer("btf", "UBO2014 file", ".btf", "texels", Ubo2014Settings, write, prepare)
