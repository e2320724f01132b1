"""Vectors by component do what tensors do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch.lobes.by_component import ByComponent

WHOLE = torch.rand(4, 5, 3, generator=torch.Generator().manual_seed(1))
CALLS: dict[str, Callable[[Any], Tensor]] = {
    "component": lambda w: w[..., 1],
    "last": lambda w: w[..., -1],
    "slice": lambda w: w[..., :2],
    "row": lambda w: w[1],
    "elements": lambda w: w[..., 0, 1],
    "method": lambda w: w.square().sum(-1),
    "unbind": lambda w: w.unbind(-1)[2],
    "function": lambda w: torch.cross(w, WHOLE.flip(-1), dim=-1),
    "list of them": lambda w: torch.stack([w, w]),
    "operators": lambda w: -((2.0 * w + w * w - 1.0 / (1.0 + w)) ** 2),
    "on the right": lambda w: WHOLE - w,
    "comparison": lambda w: w > 0.5,
}


@pytest.mark.parametrize("name", CALLS)
def test_whatever_a_brdf_does(name: str) -> None:
    vector = ByComponent([part.contiguous() for part in WHOLE.unbind(-1)])
    assert torch.equal(CALLS[name](vector), CALLS[name](WHOLE))


def test_a_component_is_the_tensor_that_was_given() -> None:
    parts = list(WHOLE.unbind(-1))
    assert ByComponent(parts)[..., 2] is parts[2]
