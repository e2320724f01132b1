"""A BTF as truncated factors, which can be asked for their loss before they are written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...errors import ConfigError
from ..btf import BTF
from ..options import DEFAULT_COMPONENTS
from ..store import Progress
from ..writers.views import refuse_gaps
from .colour import RGB
from .factorize import Factorization, Matrices, factorize, factorize_to
from .header import DFMF, SCALARS, Header
from .order import TOP
from .write import FactorRows, check_settings, write_factors

# Cosine of a light below which values keep their cosine: divided by it, their noise would swamp all
# others in whatever reads them.
LEAST_COSINE = 1e-3


@dataclass(frozen=True, eq=False)
class Truncated:
    """Factors of a BTF, ready to be written.

    Args:
        header: header of the file.
        factors: one factorization for each channel, or a single one.
        scalar: bytes of a number in the file.
        components: number of singular values of each factorization.
        snr_db: signal-to-noise ratio of the values, cosine included, in dB; None if the factors
            are not of linear RGB, where only the written file tells.
    """

    header: Header
    factors: tuple[FactorRows, ...]
    scalar: int
    components: int
    snr_db: float | None

    def write(self, path: Path | str) -> None:
        """Writes the file; a failure leaves nothing.

        Raises:
            DataError: a number does not fit its type.
            OutputError: the file cannot be written.
        """
        write_factors(path, self.header, self.factors, scalar=self.scalar)


def write_ubo2014(path: Path | str, btf: BTF, **settings: Any) -> None:
    """Writes a BTF as a truncated singular value decomposition; a failure leaves nothing.

    Args:
        path: file to write.
        btf: BTF to write.
        settings: as of `truncate`.

    Raises:
        ConfigError: a setting is out of its range.
        DataError: a picture cannot be decoded, a number does not fit its type, or pairs are
            missing.
        OutputError: the file cannot be written.
    """
    truncate(btf, **settings).write(path)


def truncate(
    btf: BTF,
    *,
    components: int | None = None,
    snr: float | None = None,
    scalar: int = 4,
    variant: str = DFMF,
    colour_model: int = RGB,
    log_values: bool = False,
    rows: str = TOP,
    generator: torch.Generator | None = None,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> Truncated:
    """The truncated singular value decomposition of a BTF, as a file of UBO2014 holds it.

    Values are read in blocks, a few times, and memory never holds all of them. The error of values
    that contain the cosine of the light is made small; the file then holds values without it,
    which every known reader accepts. Only a light at the horizon makes them keep it.

    Args:
        btf: BTF to write.
        components: number of the largest singular values to keep, for each pair of factors; None:
            100, or as many as `snr` needs.
        snr: signal-to-noise ratio in dB that the fewest possible components are to reach, of linear
            RGB; None: as `components` says.
        scalar: bytes of a number in the file: 2, 4 or 8.
        variant: DFMF08FC (factors for each channel), FMF06FC or FMF12FCE (for all together).
        colour_model: 0 for RGB, 11 for log Y, U / Y, V / Y (DFMF08FC only).
        log_values: whether to factor the logarithms of the values (FMF12FCE only).
        rows: row of the pictures that comes first in the file: "top", as the library of the
            format's authors reads, or "bottom", as `btf.hh` and BTF_extractor do.
        generator: random generator of the decomposition, on the CPU; None: one of a fixed seed.
        device: device to compute on.
        progress: called with (texels done, texels of all passes).

    Raises:
        ConfigError: a setting is out of its range.
        DataError: a picture cannot be decoded, or pairs are missing.
    """
    refuse_gaps(btf)
    header = _header_of(btf, variant, colour_model, log_values, rows)
    check_settings(header, scalar)
    _check_size(components, snr, header)
    cosine = np.tile(np.cos(header.light[:, 0].astype(np.float64)), len(header.view))  # [D]
    header = replace(header, cosine=bool(cosine.min() < LEAST_COSINE))
    reciprocal = None if header.cosine else torch.from_numpy(1.0 / cosine)[:, None]  # [D, 1]
    linear = header.encoding.is_linear
    matrices = Matrices(
        btf,
        joint=variant != DFMF,
        encoding=header.encoding,
        factor=None if linear else reciprocal,
        dtype=torch.float64 if scalar == SCALARS[8].itemsize else torch.float32,
        device=torch.device(device),
    )
    generator = generator or torch.Generator().manual_seed(0)
    if snr is None:
        found = factorize(matrices, components or DEFAULT_COMPONENTS, generator, progress)
    else:
        found = factorize_to(matrices, snr, generator, progress)
    factors = tuple(_rows(part, reciprocal if linear else None) for part in found.factors)
    return Truncated(header, factors, scalar, found.components, found.snr_db if linear else None)


def _check_size(components: int | None, snr: float | None, header: Header) -> None:
    """Refuses a number of components, or a ratio, that means nothing."""
    if components is not None and components < 1:
        raise ConfigError(f"components is {components}; expected 1 or more.")
    if snr is None:
        return
    if components is not None:
        raise ConfigError(
            f"components is {components} and snr is {snr:g}; expected one of them, as each decides "
            f"the number of components; leave the other out."
        )
    if not header.encoding.is_linear:
        raise ConfigError(
            f"snr is {snr:g} for a file of colour model {header.colour_model} or of logarithms; "
            f"expected linear RGB (colour model 0); give components instead."
        )


def _header_of(btf: BTF, variant: str, colour_model: int, log_values: bool, rows: str) -> Header:
    """The header of the file of a BTF."""
    return Header(
        variant=variant,
        width=btf.width,
        height=btf.height,
        view=_angles(btf.view),
        light=_angles(btf.light),
        colour_model=colour_model,
        log_values=log_values,
        rows=rows,
    )


def _angles(directions: Tensor) -> np.ndarray:
    """Angles (polar, azimuth) `[N, 2]` float32 of unit vectors `[N, 3]`, in radians."""
    x, y, z = directions.double().unbind(-1)
    azimuth = torch.atan2(y, x).remainder(2.0 * torch.pi)
    return torch.stack((torch.atan2(torch.hypot(x, y), z), azimuth), dim=-1).float().numpy()


def _rows(factors: Factorization, factor: Tensor | None) -> FactorRows:
    """Factors to write, with those of each direction pair times a factor `[D, 1]`; None: 1."""
    singular_values, left, right = factors
    if factor is not None:
        repeated = factor.repeat_interleave(len(left) // len(factor), dim=0)  # [rows, 1]
        left = left * repeated.to(left)
    return FactorRows(singular_values, left, right)
