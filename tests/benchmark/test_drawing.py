"""Pictures of any method: through a relief they are those of the model, and errors are known."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM
from spmm_torch.benchmark.drawing import flip_of_pictures, snr_of_pictures, through
from spmm_torch.model.relief import Relief
from tests.planted.btfs import measured
from tests.planted.models import planted_relief, with_relief, with_residual

SIDE = 8


@pytest.fixture(scope="module")
def model() -> SPMM:
    return with_residual(SIDE)


@pytest.fixture(scope="module")
def btf(model: SPMM) -> BTF:
    """The BTF of the flat model."""
    return measured(model)


def surface_points(btf: BTF):  # noqa: ANN201
    def of_view(view: int) -> Tensor:
        return btf.pictures(view).flatten(1, 2).transpose(0, 1)

    return of_view


@pytest.mark.parametrize("rule", ["repeat", "mirror"])
def test_a_relief_shows_what_the_model_shows_through_it(model: SPMM, btf: BTF, rule: str) -> None:
    relief = planted_relief(SIDE, SIDE, rule=rule)
    raised = with_relief(model, relief)
    seen = through(surface_points(btf), btf, relief)
    for view, light in ((0, 1), (3, 2), (len(btf.view) - 1, 0)):
        picture = raised.picture(btf.light[light], btf.view[view]).flatten(0, 1)
        assert seen(view)[:, light] == pytest.approx(picture.detach(), abs=1e-4)


def test_drift_moves_pictures_by_as_much(btf: BTF) -> None:
    drift = torch.zeros(len(btf.view), 2)
    drift[1, 0] = 1.0 / SIDE  # what stands one texel further right is shown
    seen = through(surface_points(btf), btf, Relief.of_heights(torch.zeros(SIDE**2), drift=drift))
    own, moved = (part.view(SIDE, SIDE, -1) for part in (btf.pictures(1)[0], seen(1)[:, 0]))
    assert moved == pytest.approx(own.roll(-1, dims=1), abs=1e-4)
    assert torch.equal(seen(0), surface_points(btf)(0))


def test_errors_are_those_of_all_values(btf: BTF) -> None:
    def darker(view: int) -> Tensor:
        return 0.9 * surface_points(btf)(view)

    assert snr_of_pictures(btf, surface_points(btf)) == math.inf
    assert snr_of_pictures(btf, darker) == pytest.approx(20.0, abs=1e-4)


def test_flip_is_small_where_pictures_are_alike(btf: BTF) -> None:
    pytest.importorskip("flip_evaluator")

    def dark(view: int) -> Tensor:
        return torch.zeros_like(surface_points(btf)(view))

    alike, unlike = flip_of_pictures(btf, surface_points(btf)), flip_of_pictures(btf, dark)
    assert alike is not None and unlike is not None
    assert alike == pytest.approx(0.0, abs=1e-6) and unlike > 0.1
