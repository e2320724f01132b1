"""Models that training has led out of their bounds are told of, mended on demand, and saved."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import REGISTRY
from spmm_torch.errors import OutputError
from spmm_torch.geometry.directions import MAX_TILT, direction_from_angles
from spmm_torch.runtime import tensor_file
from tests.planted.models import planted_model

UP = torch.tensor([0.0, 0.0, 1.0])
SIDE = direction_from_angles(torch.tensor(0.4), torch.tensor(1.0))
UV = torch.tensor([0.3, 0.4])


@torch.no_grad()
def test_a_file_with_nan_is_refused(tmp_path: Path) -> None:
    model = planted_model()
    model.weight[3, 1] = torch.nan
    (tmp_path / "model.safetensors").write_bytes(tensor_file.pack(*model.to_tensors()))
    with pytest.raises(OutputError, match=r"holds no valid model: weight holds NaN or infinity"):
        SPMM.load(tmp_path)


@pytest.mark.parametrize("part", ["kappa", "normal", "angle", "weight"])
def test_what_is_not_finite_is_not_saved(tmp_path: Path, part: str) -> None:
    model = planted_model()
    with torch.no_grad():
        getattr(model, part)[0] = torch.inf
    with pytest.raises(OutputError, match=f"{part} holds NaN or infinity"):
        model.save(tmp_path / "x.safetensors")
    assert not list(tmp_path.iterdir())


def test_weights_below_zero_are_not_saved_unless_projected(tmp_path: Path) -> None:
    model = planted_model()
    with torch.no_grad():
        model.weight[5] = -0.25
        model.normal[1] *= 2.0
    with pytest.raises(OutputError, match=r"weight goes down to -0\.25, below 0.*project_\(\)"):
        model.save(tmp_path / "x.safetensors")
    expected = model.weight.detach().clamp(min=0.0)
    assert model.project_() is model
    model.save(tmp_path / "x.safetensors")
    assert torch.equal(SPMM.load(tmp_path / "x.safetensors").weight, expected)
    model.save(tmp_path)
    assert (tmp_path / "model.safetensors").read_bytes() == model.pack()


def test_valid_parameters_keep_their_bits() -> None:
    model, same = planted_model(), planted_model()
    same.project_()
    for name, value in model.state_dict().items():
        assert torch.equal(value, same.state_dict()[name]), name


@torch.no_grad()
def test_projection() -> None:
    model = planted_model()
    model.normal[0] = torch.tensor([0.0, 0.0, -1.0])
    model.normal[1] = 3.0 * direction_from_angles(torch.tensor(1.55), torch.tensor(2.0))
    model.kappa[2] = 1e9
    model.kappa[3] = -1e9
    model.project_()
    assert torch.allclose(model.normal.norm(dim=1), torch.ones(len(model.normal)), atol=1e-6)
    tilt = torch.arccos(model.normal[:, 2])
    assert float(tilt.max()) <= MAX_TILT + 1e-5
    assert float(tilt[1]) == pytest.approx(MAX_TILT, abs=1e-5)
    for lobe, bound in ((2, "high"), (3, "low")):
        rows = REGISTRY[int(model.lobe_model[lobe])].parameters
        wanted = [getattr(row, bound) for row in rows]
        assert model.kappa[lobe, : len(rows)].tolist() == pytest.approx(wanted)


def test_samples_follow_training() -> None:
    model = planted_model()
    before = model.pdf(UV, SIDE, UP)
    assert model.sampling_data() is model.sampling_data()
    optimizer = torch.optim.Adam([model.weight, model.kappa], lr=0.05)
    for _ in range(3):
        optimizer.zero_grad()
        (-model(UV, SIDE, UP).sum()).backward()
        optimizer.step()
        model.project_()
    fresh = SPMM.from_tensors(*model.to_tensors())
    after = model.pdf(UV, SIDE, UP)
    assert torch.equal(after, fresh.pdf(UV, SIDE, UP))
    assert not torch.equal(after, before)
    u = torch.rand(64, 3, generator=torch.Generator().manual_seed(1))
    assert all(map(torch.equal, model.sample(UV, UP, u), fresh.sample(UV, UP, u)))
