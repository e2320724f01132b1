"""One parameter of lobes set."""

from __future__ import annotations

import pytest

from spmm_torch import SPMM, ConfigError
from spmm_torch.brdf import REGISTRY
from spmm_torch.edit import lobe_selection, set_parameter
from tests.edit.looks import check_valid


def parameters(model: SPMM, name: str) -> list[float]:
    """The values of all parameters of a name."""
    lobes = model.dictionary
    return [
        lobes.kappa[j, column].item()
        for j, index in enumerate(lobes.model.tolist())
        for column, row in enumerate(REGISTRY[index].parameters)
        if row.name == name
    ]


def test_set_parameter(model: SPMM) -> None:
    edited = set_parameter(model, "f0", 0.5)
    assert set(parameters(edited, "f0")) == {0.5}
    assert parameters(edited, "exponent") == parameters(model, "exponent")
    where = lobe_selection(model, models=["cook_torrance"])
    some = set_parameter(model, "f0", 0.5, where)
    kept = [v for v in parameters(model, "f0") if v in parameters(some, "f0")]
    assert 0.5 in parameters(some, "f0")
    assert kept
    check_valid(some)


def test_bad_parameters(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="no lobe .* has a parameter exponen; did you mean exp"):
        set_parameter(model, "exponen", 3.0)
    with pytest.raises(ConfigError, match="f0 of cook_torrance is 2; expected 0.01 to 1"):
        set_parameter(model, "f0", 2.0)
