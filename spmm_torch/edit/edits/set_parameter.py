"""One parameter of lobes set to a value; beyond the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from ...brdf import MODEL_NAMES, REGISTRY, Parameter
from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...lobes.batch import LobeBatch
from ...model.spmm import SPMM
from ..lobes import with_lobes
from ..options import nearest
from ..selection import EVERYTHING, Selection


@dataclass(frozen=True)
class SetParameter:
    """One parameter of lobes, set to a value."""

    name: str = setting(REQUIRED, "the name of a parameter of a BRDF, such as exponent")
    value: float = setting(REQUIRED, "its value, in its own unit")

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return set_parameter(model, self.name, self.value, where)


@torch.no_grad()
def set_parameter(model: SPMM, name: str, value: float, where: Selection = EVERYTHING) -> SPMM:
    """Sets a parameter of all selected lobes whose model has one of this name.

    Weights and the residual are kept.

    Args:
        model: the original.
        name: as in the tables of the BRDFs, such as `exponent`, `alpha` or `f0`.
        value: in its own unit.
        where: what is edited.

    Raises:
        ConfigError: no lobe of the model has it, or the value is out of its physical bounds.
    """
    lobes = model.dictionary.detach()
    kappa, found = lobes.kappa.clone(), False
    for index, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[index].parameters):
            if row.name == name:
                _check_value(row, value, MODEL_NAMES[index])
                kappa[rows, column], found = value, True
    if not found:
        raise ConfigError(
            f"no lobe of the model has a parameter {name}; {nearest(name, _parameters(lobes))}"
        )
    return with_lobes(model, replace(lobes, kappa=kappa), where)


def _check_value(row: Parameter, value: float, owner: str) -> None:
    if not row.low <= value <= row.high:
        raise ConfigError(
            f"{row.name} of {owner} is {value:g}; expected {row.low:g} to {row.high:g}."
        )


def _parameters(lobes: LobeBatch) -> list[str]:
    """The names of all parameters of the models that occur."""
    names = {row.name for index, _ in lobes.by_model() for row in REGISTRY[index].parameters}
    return sorted(names)
