"""Measured samples of one texel, to show beside its model."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF, load_input
from ..errors import DataError
from ..geometry.directions import texel_at
from ..geometry.relief import texel_centres
from ..model.spmm import SPMM
from ..report.contract import FILE_NAME as REPORT
from ..runs.folder import CONFIG


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

    A relief shifts the texel in the picture of the view: what is seen there may stand before it.

    Raises:
        DataError: the BTF has another size than the model.
    """
    if (btf.height, btf.width) != (model.height, model.width):
        raise DataError(
            f"{btf.path} has {btf.width} x {btf.height} texels and the model {model.width} x "
            f"{model.height}; expected the BTF of the model; give another --against."
        )
    view = int(torch.argmax(btf.view @ wo.to(btf.view)))
    index, weight = _places(model, texel, btf.view[view])  # [n]
    part = btf.restricted(index, (1, len(index)), views=torch.tensor([view]))
    value = (part.texels() * weight[:, None, None]).sum(0)  # [L, C]
    return Measured(btf.view[view], btf.light, value)


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

    It is read with the data settings of the run: gamma, cosine and crop, and the names of pictures
    unless `pattern` says how they are named.

    Raises:
        DataError: the BTF cannot be read.
    """
    config_file, report_file = run / CONFIG, run / REPORT
    config = FitConfig.from_yaml(config_file) if config_file.is_file() else FitConfig()
    if against is None:
        if not report_file.is_file():
            return None
        against = json.loads(report_file.read_text(encoding="utf-8")).get("input")
        if not against or not Path(against).exists():
            return None
    settings = replace(config.data, pattern=pattern or config.data.pattern)
    return load_input(against, settings, config.seed)
