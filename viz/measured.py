"""Measured samples of one texel, to show beside its model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..data import BTF
from ..errors import DataError
from ..geometry.directions import texel_at
from ..geometry.relief import texel_centres
from ..model.spmm import SPMM
from ..runs.inputs import has_input, read_input


@dataclass(frozen=True)
class Measured:
    """The samples of a texel under one measured view.

    Attributes:
        wo: the view `[3]`.
        wi: lights `[L, 3]`.
        value: linear RGB `[L, C]`.
    """

    wo: Tensor
    wi: Tensor
    value: Tensor


def measured_samples(btf: BTF, model: SPMM, texel: int, wo: Tensor) -> Measured:
    """The samples of a texel under the measured view nearest to wo `[3]`; decodes only these.

    Pairs without a picture are no samples. A relief shifts the texel in the picture of the view:
    what is seen there may stand before it.

    Raises:
        DataError: the BTF has another size than the model.
    """
    if (btf.height, btf.width) != (model.height, model.width):
        raise DataError(
            f"{btf.path} has {btf.width} x {btf.height} texels and the model {model.width} x "
            f"{model.height}; expected the BTF of the model; give another --against."
        )
    pictures = torch.ones(len(btf.view), len(btf.light), dtype=torch.bool)
    if btf.missing is not None:
        pictures = ~btf.missing
    near = btf.view @ wo.to(btf.view)  # [V]
    view = int(near.masked_fill(~pictures.any(1), -torch.inf).argmax())
    lights = torch.nonzero(pictures[view]).squeeze(1)
    index, weight = _places(model, texel, btf.view[view])  # [n]
    part = btf.restricted(index, (1, len(index)), views=torch.tensor([view]), lights=lights)
    value = (part.texels() * weight[:, None, None]).sum(0)  # [L, C]
    return Measured(part.view[0], part.light, value)


def _places(model: SPMM, texel: int, wo: Tensor) -> tuple[Tensor, Tensor]:
    """The texels `[n]` of a picture from wo `[3]` that show a texel, and their weights `[n]`."""
    if model.relief is None:
        return torch.tensor([texel]), torch.ones(1)
    rows, columns = model.height, model.width
    field = model.relief.field(rows, columns, model.view)
    place = field.place(texel_centres(rows, columns, model.view)[texel], wo.to(model.view))
    index, weight = texel_at(place.detach().cpu(), rows, columns, model.rule)
    return index, weight


def measured_input(run: Path, against: str | None, pattern: str | None = None) -> BTF | None:
    """The BTF `against`, or else the input of the run; None where that no longer exists.

    It is read as the fit of the run read it, but for the names of pictures where `pattern` says how
    they are named.

    Raises:
        ConfigError: the settings of the run are gone or not valid.
        DataError: the BTF cannot be read.
    """
    if against is None and not has_input(run):
        return None
    return read_input(run, against, pattern)
