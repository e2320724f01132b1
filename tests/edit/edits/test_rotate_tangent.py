"""Tangents turned."""

from __future__ import annotations

import math

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.brdf import REGISTRY
from spmm_torch.edit import replace_model, rotate_tangent
from tests.edit.looks import look


def test_tangents_turn_where_there_are_some(model: SPMM) -> None:
    edited = rotate_tangent(model, 0.5)
    turned = (edited.angle != model.angle).tolist()
    anisotropic = [REGISTRY[index].anisotropic for index in model.lobe_model.tolist()]
    assert turned == anisotropic
    back = look(rotate_tangent(model, math.pi))  # Ward and Ashikhmin-Shirley are symmetric
    torch.testing.assert_close(back, look(model), rtol=1e-3, atol=1e-4)


def test_identity_changes_nothing(model: SPMM) -> None:
    assert rotate_tangent(model, 0.0) is model


def test_bad_input(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="has no anisotropic lobes"):
        rotate_tangent(replace_model(model, "lambertian"), 1.0)
    with pytest.raises(ConfigError, match="tangents is inf; expected a finite angle"):
        rotate_tangent(model, math.inf)
