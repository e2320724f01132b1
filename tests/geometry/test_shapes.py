"""Shapes that broadcast, and what finding them loads."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes

from spmm_torch.geometry.shapes import broadcast_shape

SHAPES = mutually_broadcastable_shapes(num_shapes=3, min_side=0, max_dims=4)


@given(SHAPES.map(lambda found: found.input_shapes))
def test_as_torch_has_it(shapes: tuple[tuple[int, ...], ...]) -> None:
    assert broadcast_shape(*shapes) == torch.broadcast_shapes(*shapes)


@given(st.lists(st.lists(st.integers(0, 3), max_size=3), min_size=2, max_size=3))
def test_shapes_that_do_not_broadcast_are_refused(shapes: list[list[int]]) -> None:
    try:
        expected = torch.broadcast_shapes(*shapes)
    except RuntimeError:
        with pytest.raises(RuntimeError):
            broadcast_shape(*shapes)
    else:
        assert broadcast_shape(*shapes) == expected


def test_nothing_broadcasts_to_nothing() -> None:
    assert broadcast_shape() == torch.Size()


def test_a_model_is_evaluated_without_computer_algebra() -> None:
    """The first call of `torch.broadcast_shapes` took longer than most of `spmm render`."""
    code = """
import sys, torch
from tests.planted.models import planted_model
wi = torch.tensor([[0.0, 0.0, 1.0]])
planted_model(2)(torch.tensor([[0.5, 0.5]]), wi, wi)
assert "sympy" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
