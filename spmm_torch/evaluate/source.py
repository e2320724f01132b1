"""A run and its input, opened again for comparison."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..data import BTF
from ..data.scattered_btf import ScatteredBTF
from ..errors import DataError
from ..geometry.neighbours import measured_alike
from ..model.spmm import SPMM
from ..runs.inputs import read_input, read_report


@dataclass(frozen=True)
class Source:
    """A run and the BTF that it is judged against.

    Attributes:
        run: its folder.
        report: the figures of its fit.
        model: on the chosen device.
        btf: the texels that the model was fitted to, under all directions of the input.
        views, lights: whether the fit saw each direction of the BTF, `[V]`, `[L]` bool.
    """

    run: Path
    report: dict[str, Any]
    model: SPMM
    btf: BTF
    views: Tensor
    lights: Tensor

    @property
    def fitted(self) -> Tensor:
        """Direction pairs that the fit saw, `[D]` bool."""
        return self._measured((self.views[:, None] & self.lights).flatten())

    @property
    def held_out(self) -> Tensor:
        """Direction pairs that were measured and that the fit did not see, `[D]` bool."""
        return self._measured(~(self.views[:, None] & self.lights).flatten())

    def _measured(self, pairs: Tensor) -> Tensor:
        return pairs if self.btf.measured is None else pairs & self.btf.measured

    def fitted_part(self) -> BTF:
        """The BTF as the fit saw it."""
        if bool(self.views.all() and self.lights.all()):
            return self.btf
        views, lights = (torch.nonzero(part).squeeze(1) for part in (self.views, self.lights))
        return self.btf.restricted(views=views, lights=lights)


def open_source(
    run: Path | str,
    against: Path | str | None,
    device: torch.device | str = "cpu",
    pattern: str | None = None,
) -> Source:
    """A run and its own input, or the BTF `against`; either is read with the run's settings.

    Args:
        run: its folder.
        against: path of a BTF; None: the input of the run.
        device: of the model.
        pattern: how pictures are named; None: as in the run's settings.

    Raises:
        ConfigError: the pattern is malformed.
        OutputError: the run does not exist, or a part of it is missing.
        DataError: the input does not exist, or has other texels or directions.
    """
    folder = Path(run)
    model = SPMM.load(folder, device)
    report = read_report(folder)
    btf = read_input(folder, against, pattern, all_directions=True)
    path = btf.path
    _check_size(btf, model, path, folder)
    views, lights = _seen(btf.view, model.view), _seen(btf.light, model.light)
    if isinstance(btf, ScatteredBTF):  # any samples judge a model
        return Source(folder, report, model, btf, views, lights)
    if views.sum() != len(model.view) or lights.sum() != len(model.light):
        raise DataError(
            f"{path} has {int(views.sum())} of the {len(model.view)} view directions and "
            f"{int(lights.sum())} of the {len(model.light)} light directions of {run}; expected "
            f"all of them; give the input that the run was fitted to."
        )
    return Source(folder, report, model, btf, views, lights)


def _check_size(btf: BTF, model: SPMM, path: str, run: Path) -> None:
    if (btf.height, btf.width) != (model.height, model.width):
        raise DataError(
            f"{path} has {btf.width} x {btf.height} texels under the settings of {run}, whose "
            f"model has {model.width} x {model.height}; give the input that it was fitted to."
        )


def _seen(directions: Tensor, fitted: Tensor) -> Tensor:
    """Which of `directions [N, 3]` are among those of the fit, `[N]` bool."""
    return measured_alike(directions.cpu(), fitted)[0]
