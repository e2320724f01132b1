"""The `.btf` files of UBO2014: factorizations of a BTF, which are never expanded as a whole.

`header` describes a file, `layout` parses and checks it, `store` computes values from the factors,
and `colour` converts them to RGB; `truncate`, `factorize` and `write` make such files.

Conventions where the format leaves a choice to the reader:

* Values are cosine-weighted. The cosine flag tells whether the cosine of the light is "already
  multiplied into the data" (the format's authors); where the flag is zero, values are multiplied
  by it here. Headers of version 0 and 1 have no flag: the cosine is taken as included. Written
  files hold values without it, as `btf.hh` stops at the flag 1 where its assertions are on.
* Pictures and the height map start with their top row, as in the library of the format's authors
  (`decode_dfmf_texture`) and pysmtb; `btf.hh` and BTF_extractor take the bottom row to come first.
  Written files state their order (`order`); for all others `options.rows` decides.
* The factored matrix may be the transpose, of texels by pairs: the rows of U tell, as there.
* Reconstruction rings below zero in places: such values become zero. There is no upper limit.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ...geometry.directions import direction_from_angles
from ..btf import BTF
from ..directions import checked_directions
from ..options import DEFAULT_OPTIONS, ReadOptions
from ..pictures import material_name
from .header import MAGICS, Header
from .layout import read_header, read_layout
from .store import FactorStore, open_store
from .truncate import truncate, write_ubo2014
from .write import FactorRows, write_factors

__all__ = [
    "EXPECTED",
    "FactorRows",
    "FactorStore",
    "Header",
    "accepts",
    "read",
    "read_header",
    "truncate",
    "write_factors",
    "write_ubo2014",
]

EXPECTED = "a UBO2014 .btf"
# Note on a file that does not state the order of its rows.
ASSUMED = (
    "{} does not tell which row of its pictures comes first: the {} row is taken (data.rows); the "
    "library of the format's authors takes the top row, btf.hh and spmm before 0.2 the bottom row"
)
# Largest bytes of a value, float32, by which the raw size of a BTF is counted.
MAX_BYTES_PER_VALUE = 4


def accepts(path: Path) -> bool:
    """Whether a file starts like one of the Bonn formats, including those not readable here."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(max(map(len, MAGICS))).startswith(MAGICS)


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens a `.btf` file: reads and checks everything except for the factors.

    Values are linear, so that `options.gamma` has no effect.

    Raises:
        DataError: the file is not supported or damaged, or a direction is not valid.
    """
    source = Path(path)
    layout = read_layout(source, options.rows)
    header = layout.header
    return BTF(
        name=material_name(source),
        path=str(path),
        height=header.height,
        width=header.width,
        view=_unit_vectors(header.view, f"the set of views in {source}"),
        light=_unit_vectors(header.light, f"the set of lights in {source}"),
        bytes_per_value=min(layout.scalar_bytes, MAX_BYTES_PER_VALUE),
        open_store=partial(open_store, source, layout),
        hdr=None,
        streamed=True,
        cosine_missing=header.cosine is False,
        notes=() if header.rows else (ASSUMED.format(path, layout.rows),),
    )


def _unit_vectors(angles: np.ndarray, where: str) -> Tensor:
    """Checked unit vectors `[N, 3]` of angles (polar, azimuth) `[N, 2]`, in radians."""
    polar, azimuth = torch.from_numpy(angles).double().unbind(-1)
    return checked_directions(direction_from_angles(polar, azimuth), where)
