"""Errors against scattered samples, as the model itself gives them, sample by sample."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from spmm_torch import load_btf
from spmm_torch.data.scattered_btf import ScatteredBTF
from spmm_torch.evaluate import sample_errors as module
from spmm_torch.evaluate.sample_errors import sample_errors
from tests.planted.models import planted_model
from tests.planted.scattered import save_samples


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("block", [None, 64])
def test_sums_are_those_of_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shared: bool, block: int | None
) -> None:
    if block is not None:
        monkeypatch.setattr(module, "BLOCK_VALUES", block)
    model = planted_model(size=2, residual=0.02)
    texels = model.texel_count
    btf = load_btf(save_samples(tmp_path / "a.npz", texels, 25, shared=shared))
    assert isinstance(btf, ScatteredBTF)
    found = sample_errors(model, btf)
    without, whole = torch.zeros(texels).double(), torch.zeros(texels).double()
    energy = torch.zeros(texels).double()
    for texel in range(texels):
        row, column = divmod(texel, model.width)
        place = torch.tensor([(column + 0.5) / model.width, 1.0 - (row + 0.5) / model.height])
        wi, wo, values = btf.samples(texel)
        with torch.no_grad():
            for sums, residual in ((without, False), (whole, True)):
                shown = model(place.expand(len(wi), 2), wi, wo, residual=residual)
                sums[texel] = (shown - values).double().square().sum()
        energy[texel] = values.double().square().sum()
    torch.testing.assert_close(found.texel_energy, energy)
    torch.testing.assert_close(found.texel_error, whole, rtol=1e-4, atol=1e-6)
    assert found.without_residual == pytest.approx(float(without.sum()), rel=1e-4)
    assert float(found.table.energy.sum()) == pytest.approx(found.energy)
    assert float(found.table.error.sum()) == pytest.approx(found.with_residual)
    shares = [entry["error_share"] for entry in found.worst]
    assert shares == sorted(shares, reverse=True)
    assert len(shares) == module.LISTED
