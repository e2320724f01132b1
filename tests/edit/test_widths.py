"""Widths and the parameters that set them."""

from __future__ import annotations

import pytest

from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.edit.widths import power_law


@pytest.mark.parametrize("brdf", REGISTRY, ids=MODEL_NAMES)
def test_every_width_parameter_is_a_power_law(brdf) -> None:  # noqa: ANN001
    """What `power_law` relies on."""
    for row in brdf.parameters:
        if row.from_width is not None:
            a, b = power_law(row.from_width)
            for width in (0.02, 0.3, 0.9):
                assert row.from_width(width) == pytest.approx(a * width**b)
