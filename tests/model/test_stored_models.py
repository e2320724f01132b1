"""A model file names the BRDFs of format 1, and later ones only as far as it uses them."""

from __future__ import annotations

import json

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import BRDF, MAX_PARAMETERS, MODEL_NAMES, REGISTRY, Parameter
from spmm_torch.model import stored_models
from spmm_torch.model.stored_models import (
    FORMAT_1_MODELS,
    loaded_kappa,
    loaded_models,
    stored_kappa,
    stored_names,
)
from tests.planted.models import planted_model

# Two models more than there are, the last with more parameters than any.
EXTENDED = (*MODEL_NAMES, "later", "latest")
ROW = Parameter("x", 0.0, 1.0, "linear", "planted")


class Latest(BRDF):
    """A planted model of many parameters."""

    parameters = (ROW,) * (MAX_PARAMETERS + 2)
    eval = sample = pdf = None  # type: ignore[assignment]


@pytest.fixture
def extended(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that knows two more models."""
    monkeypatch.setattr(stored_models, "MODEL_NAMES", EXTENDED)
    monkeypatch.setattr(stored_models, "REGISTRY", (*REGISTRY, Latest(), Latest()))
    monkeypatch.setattr(stored_models, "MAX_PARAMETERS", MAX_PARAMETERS + 2)


def test_files_name_the_models_of_format_1() -> None:
    assert MODEL_NAMES[:FORMAT_1_MODELS][-1] == "ward_duer"
    for used in ([], [0], [3, 1, 2], [7]):
        assert stored_names(torch.tensor(used, dtype=torch.long)) == MODEL_NAMES[:8]


@pytest.mark.usefixtures("extended")
def test_a_model_that_is_not_used_changes_no_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file of a program that knows more models is that of one that does not."""
    model = planted_model()
    content = model.pack()
    assert json.loads(model.to_tensors()[1]["models"]) == list(MODEL_NAMES[:8])
    monkeypatch.undo()
    assert planted_model().pack() == content


@pytest.mark.usefixtures("extended")
def test_a_later_model_is_named_if_it_is_used() -> None:
    place = EXTENDED.index("later")
    assert stored_names(torch.tensor([0, place])) == EXTENDED[:-1]
    assert stored_names(torch.tensor([place + 1])) == EXTENDED


@pytest.mark.usefixtures("extended")
def test_kappa_is_as_wide_as_the_named_models_need() -> None:
    kappa = torch.rand(4, MAX_PARAMETERS + 2)
    assert torch.equal(stored_kappa(kappa, MODEL_NAMES[:8]), kappa[:, :3])
    assert torch.equal(stored_kappa(kappa, EXTENDED), kappa)
    widened = loaded_kappa(kappa[:, :3])
    assert torch.equal(widened[:, :3], kappa[:, :3])
    assert widened.shape == kappa.shape
    assert not bool(widened[:, 3:].any())


def test_models_are_found_by_their_names() -> None:
    names = ["ward", "lambertian"]
    found = loaded_models(torch.tensor([1, 0, 0], dtype=torch.uint8), names)
    assert [MODEL_NAMES[index] for index in found.tolist()] == ["lambertian", "ward", "ward"]


def test_only_models_in_use_must_be_known() -> None:
    names = ["ward", "drawn", "lambertian"]
    assert loaded_models(torch.tensor([2]), names).tolist() == [0]
    with pytest.raises(ValueError, match="BRDF drawn; known: lambertian, "):
        loaded_models(torch.tensor([0, 1]), names)
    with pytest.raises(ValueError, match="BRDF number 3; known"):
        loaded_models(torch.tensor([3]), names)


def test_a_file_with_narrow_kappa_loads() -> None:
    """As a program writes it whose models have fewer parameters."""
    model = planted_model(names=("lambertian", "ward"))
    tensors, metadata = model.to_tensors()
    tensors["dictionary.kappa"] = tensors["dictionary.kappa"][:, :2]
    loaded = SPMM.from_tensors(tensors, metadata)
    assert loaded.kappa.shape == model.kappa.shape
    assert torch.equal(loaded.kappa, model.kappa)
