"""Normal matrix and products of the weights, against the values that each entry shows."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from spmm_torch.fit.refit import normal
from spmm_torch.fit.refit.normal import normal_matrix
from spmm_torch.fit.refit.projections import Projections, project
from spmm_torch.geometry.directions import RULES
from spmm_torch.runtime.ranks import ALONE
from tests.fit.refit.refit_cases import CASES, Case, case, silent

CLOSE: dict[str, Any] = {"rtol": 1e-4, "atol": 1e-4}


@pytest.fixture(params=[*CASES, "many blocks"])
def sample(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Case:
    if request.param != "many blocks":
        return CASES[request.param]
    monkeypatch.setattr(normal, "PAIR_BLOCK", 7)
    monkeypatch.setattr(normal, "VIEW_BLOCK", 2)
    monkeypatch.setattr(normal, "PRODUCT_BYTES", 3 * 4 * CASES["weighted"].scaled_rho.shape[1] ** 2)
    return CASES["weighted"]


def check_normal(sample: Case) -> None:
    design = sample.lobe_design().flatten(0, 2)  # [V T L, N]
    found = normal_matrix(sample.entries, sample.scaled_rho, sample.lookups)
    expected = (design.T @ design).float()
    torch.testing.assert_close(found.matrix @ torch.eye(len(expected)), expected, **CLOSE)
    torch.testing.assert_close(found.diagonal, expected.diagonal(), **CLOSE)


def test_normal_matrix(sample: Case) -> None:
    check_normal(sample)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 2), (2, 5)], ids=str)
def test_normal_matrix_of_few_rows_and_columns(size: tuple[int, int], rule: str) -> None:
    """The texels around a texel are then the same ones from several sides."""
    check_normal(case(*size, rule=rule, drift=True))


def projected(sample: Case, labels: torch.Tensor) -> Projections:
    return project(
        sample.pictures,
        sample.scale,
        sample.lookups,
        sample.entries,
        sample.scaled_rho,
        labels,
        ALONE,
        silent,
    )


def test_products(sample: Case) -> None:
    labels = torch.arange(sample.pictures.texel_count) % 3
    found = projected(sample, labels)
    values = sample.values()  # [V, T, L, C]
    expected = torch.einsum("vpln,vplc->nc", sample.lobe_design(), values)
    torch.testing.assert_close(found.lobes, expected, rtol=1e-5, atol=1e-5)
    assert found.energy == pytest.approx(float(values.square().sum()), rel=1e-6)


def test_energy_of_cluster_means(sample: Case) -> None:
    """What is left of it is the least error that one function of each cluster can have."""
    labels = torch.arange(sample.pictures.texel_count) % 3
    found = projected(sample, labels)
    importance = sample.importance
    weight = torch.ones(len(labels)) if importance is None else importance
    member = torch.nn.functional.one_hot(labels).double() * weight.double().sqrt()[:, None]
    values = sample.values().transpose(0, 1).flatten(1)  # [T, V L C]
    best = torch.linalg.lstsq(member, values).solution
    left = (values - member @ best).square().sum()
    assert found.energy - found.means == pytest.approx(float(left), rel=1e-5)


def test_products_survive_a_checkpoint() -> None:
    found = projected(CASES["relief"], torch.zeros(20, dtype=torch.long))
    again = Projections.from_tensors(found.to_tensors()).to(torch.device("cpu"))
    assert torch.equal(again.lobes, found.lobes)
    assert (again.energy, again.means) == (found.energy, found.means)
