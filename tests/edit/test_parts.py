"""Models with other parts, and what their files keep of those that did not change."""

from __future__ import annotations

from pathlib import Path

import torch

from spmm_torch import SPMM
from spmm_torch.edit.parts import with_parts
from spmm_torch.model.lookup import SparseWeights
from spmm_torch.model.stored_weights import rounded
from tests.planted.models import planted_model


@torch.no_grad()
def test_the_file_keeps_weights_that_did_not_change(tmp_path: Path) -> None:
    model = planted_model()
    model.weight_type = torch.uint8
    model.weight.copy_(rounded(model.sparse_weights, torch.uint8).weight)
    weight = model.weight.detach().clone()
    weight[0] *= 3.0 * weight.max() / weight[0]  # more than the range of the others
    offset, index = model.offset, model.index
    edited = with_parts(model, weights=SparseWeights(offset, index, weight))
    path = tmp_path / "model.safetensors"
    path.write_bytes(edited.pack())
    found = SPMM.load(path).weight
    torch.testing.assert_close(found[1:], model.weight[1:], rtol=5e-4, atol=0.0)
    assert with_parts(model, labels=model.labels).weight_type == torch.uint8
