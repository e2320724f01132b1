"""BTFs from whatever Python holds numbers in: arrays of any strides, other byte orders, lists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch import BTF, DataError
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((0.0, 1), (45.0, 4))).numpy()
VALUES = np.random.default_rng(0).random((5, 5, 2, 3, 3)).astype(np.float32)
FORMS: dict[str, Any] = {
    "negative strides": (VALUES[::-1], DIRECTIONS[::-1], DIRECTIONS),
    "every second": (np.repeat(VALUES, 2, 0)[::2], np.repeat(DIRECTIONS, 2, 0)[::2], DIRECTIONS),
    "lists": (VALUES.tolist(), DIRECTIONS.tolist(), [tuple(row) for row in DIRECTIONS.tolist()]),
    "other byte order": (VALUES, DIRECTIONS.astype(">f8"), DIRECTIONS.astype(">f4")),
    "tensors": (torch.tensor(VALUES), torch.tensor(DIRECTIONS), torch.tensor(DIRECTIONS)),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_are_the_same(form: str) -> None:
    values, view, light = FORMS[form]
    btf = BTF.from_values(values, view, light)
    expected = VALUES[::-1] if form == "negative strides" else VALUES
    assert np.array_equal(btf.picture(1, 2).numpy(), expected[1, 2])
    assert torch.allclose(btf.light, torch.tensor(DIRECTIONS), atol=1e-6)


@pytest.mark.parametrize("bad", [[["a"]], [[0.0, 0.0, 1.0], [0.0]], None])
def test_what_is_no_number_is_named(bad: Any) -> None:
    with pytest.raises(DataError, match="'view' of .* is no array of numbers"):
        BTF.from_values(VALUES, bad, DIRECTIONS)
