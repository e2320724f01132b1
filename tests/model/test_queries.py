"""Queries that no model can answer are refused in one sentence, unless the check is off."""

from __future__ import annotations

import re

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.errors import DataError
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.model.relief import Relief
from tests.planted.models import planted_model, with_relief

NAN, INF = float("nan"), float("inf")
DOWN = torch.tensor([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def model() -> SPMM:
    return planted_model()


def queries() -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(0)
    angles = torch.rand(2, 4, generator=generator)
    return {
        "uv": torch.rand(4, 2, generator=generator),
        "wi": direction_from_angles(angles[0], angles[1]),
        "wo": direction_from_angles(angles[1], angles[0]),
        "u": torch.rand(4, 3, generator=generator),
    }


CALLS = {
    "forward": (lambda model, q: model(q["uv"], q["wi"], q["wo"]), ("uv", "wi", "wo")),
    "sample": (lambda model, q: model.sample(q["uv"], q["wo"], q["u"]), ("uv", "wo", "u")),
    "pdf": (lambda model, q: model.pdf(q["uv"], q["wi"], q["wo"]), ("uv", "wi", "wo")),
    "picture": (lambda model, q: model.picture(q["wi"][2], q["wo"][2]), ("wi", "wo")),
}
ASKED = [(call, name) for call, (_, names) in CALLS.items() for name in names]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("call", "name"), ASKED)
@pytest.mark.parametrize("value", [NAN, INF, 2.0])
def test_what_is_refused(
    model: SPMM, call: str, name: str, value: float, dtype: torch.dtype
) -> None:
    given = {key: part.to(dtype) for key, part in queries().items()}
    CALLS[call][0](model.to(dtype), given)
    given[name][2, 1] = value
    if name == "uv" and value == 2.0:  # the texture repeats
        CALLS[call][0](model, given)
        return
    row = 0 if call == "picture" else 2
    with pytest.raises(
        DataError, match=rf"^{name} of query {row} is \(.*{value:g}.*expected .*\.$"
    ):
        CALLS[call][0](model, given)
    model.to(torch.float32)


@pytest.mark.parametrize("scale", [0.0, 0.9, 1.1, 1000.0])
def test_directions_of_another_length(model: SPMM, scale: float) -> None:
    given = queries()
    model.float()
    expected = model(given["uv"], given["wi"], given["wo"])
    for name in ("wi", "wo"):
        wrong = given | {name: scale * given[name]}
        with pytest.raises(DataError, match=f"{name} of query 0 .* divide it by its length"):
            model(wrong["uv"], wrong["wi"], wrong["wo"])
    # Rounding of float16 and under the horizon are no mistakes.
    rounded = given["wi"].half().float()
    assert torch.allclose(model(given["uv"], rounded, given["wo"]), expected, rtol=0.1)
    assert not model(given["uv"], DOWN, given["wo"]).any()
    assert not model.pdf(given["uv"], DOWN, given["wo"]).any()


def test_the_check_can_be_switched_off() -> None:
    model, given = planted_model(), queries()
    with pytest.raises(DataError, match=re.escape("model.checks_queries = False")):
        model(given["uv"], 2.0 * given["wi"], given["wo"])
    model.checks_queries = False
    assert model(given["uv"], 2.0 * given["wi"], given["wo"]).shape == (4, 3)


@pytest.mark.parametrize("relief", [None, Relief(None, 0.0, 0.1)], ids=["flat", "relief"])
def test_no_queries(relief: Relief | None) -> None:
    model = planted_model() if relief is None else with_relief(planted_model(), relief)
    none = {name: value[:0] for name, value in queries().items()}
    assert model(none["uv"], none["wi"], none["wo"]).shape == (0, 3)
    wi, rgb, density = model.sample(none["uv"], none["wo"], none["u"])
    assert (wi.shape, rgb.shape, density.shape) == ((0, 3), (0, 3), (0,))
    assert model.pdf(none["uv"], none["wi"], none["wo"]).shape == (0,)


@pytest.mark.parametrize(("call", "name"), [pair for pair in ASKED if pair[0] != "picture"])
def test_numbers_of_queries_that_differ(model: SPMM, call: str, name: str) -> None:
    given = queries()
    given[name] = given[name][:3]
    with pytest.raises(DataError, match=rf"^queries are .*{name} of \(3,\).*that broadcast to one"):
        CALLS[call][0](model, given)


@pytest.mark.parametrize(("call", "name"), ASKED)
@pytest.mark.parametrize("count", [1, 4])
def test_shapes_that_are_refused(model: SPMM, call: str, name: str, count: int) -> None:
    given = queries()
    expected = given[name].shape[-1]
    given[name] = given[name][..., :1].expand(*given[name].shape[:-1], count)
    message = rf"^{name} has shape \([0-9, ]*{count},?\); expected \(\.\.\., {expected}\); bring"
    with pytest.raises(DataError, match=message):
        CALLS[call][0](model, given)
