"""The residual faded."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import lobe_group, lobe_selection, residual_strength
from tests.edit.looks import look


def test_residual_strength(model: SPMM) -> None:
    bare = residual_strength(model, 0.0)
    torch.testing.assert_close(look(bare), look(model, residual=False))
    assert bare.weight.data_ptr() == model.weight.data_ptr()
    half = residual_strength(model, 0.5)
    torch.testing.assert_close(look(half), 0.5 * (look(model) + look(bare)))


def test_identity_changes_nothing(model: SPMM) -> None:
    assert residual_strength(model, 1.0) is model


def test_the_residual_belongs_to_no_lobe(model: SPMM) -> None:
    for where in (lobe_group(model, "specular"), lobe_selection(model, specular=True)):
        assert residual_strength(model, 0.5, where) is model


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_bad_factors(model: SPMM, factor: float) -> None:
    with pytest.raises(ConfigError, match=r"is (-1.0|nan|inf); expected a finite number"):
        residual_strength(model, factor)
