"""FLIP of rendered pictures and of display values."""

from __future__ import annotations

import numpy as np
import pytest

from spmm_torch.evaluate.flip import flip, flip_map
from tests.evaluate.test_mssim import pictures


def test_flip_is_0_for_equal_pictures_and_grows() -> None:
    pytest.importorskip("flip_evaluator", reason="needs the extra eval")
    errors = [flip(pictures(noise))[0] for noise in (0.0, 0.02, 0.2)]
    assert errors[0] == pytest.approx(0.0, abs=1e-6)
    assert errors[0] < errors[1] < errors[2] < 1.0


@pytest.mark.parametrize("size", [(1, 1), (3, 7), (40, 20)])
def test_the_map_has_the_size_of_the_pictures(size: tuple[int, int]) -> None:
    pytest.importorskip("flip_evaluator", reason="needs the extra eval")
    grey = np.full((*size, 3), 0.5)
    assert flip_map(grey, grey).shape == size
    assert float(flip_map(grey, grey + 0.2).min()) > 0.0


def test_flip_is_unknown_without_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "flip_evaluator", None)
    assert flip(pictures(0.1)) is None
