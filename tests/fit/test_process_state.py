"""What the program around has set in PyTorch does not reach into a fit or a model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import torch

from spmm_torch import BTF, SPMM, FitConfig
from spmm_torch.fit import fit
from tests.fit.test_units import SETTINGS, pictures
from tests.planted.btfs import rough_btf
from tests.planted.settings import FLAT


@contextmanager
def double() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    try:
        yield
        assert torch.get_default_dtype() == torch.float64
    finally:
        torch.set_default_dtype(torch.float32)


def work(known: BTF, values: torch.Tensor) -> tuple[bytes, list[torch.Tensor]]:
    """A fit, and everything that its model is asked once it comes back from its file."""
    btf = BTF.from_values(values, known.view, known.light)
    found = fit(btf, FitConfig.from_dict(SETTINGS | FLAT), render=False).model
    model = SPMM.from_tensors(*found.to_tensors())
    uv, wi, wo = torch.full((3, 2), 0.3).float(), btf.light[:3], btf.view[:3]
    u = torch.full((3, 3), 0.4).float()
    answers = [model(uv, wi, wo), *model.sample(uv, wo, u), model.pdf(uv, wi, wo)]
    return found.pack(), [answer.detach().clone() for answer in answers]


@pytest.mark.parametrize("state", [torch.inference_mode, double], ids=["inference", "double"])
def test_a_fit_is_the_same(state: type) -> None:
    given = rough_btf(4), pictures()
    packed, answers = work(*given)
    with state():
        again, others = work(*given)
    assert again == packed
    assert all(map(torch.equal, answers, others))
