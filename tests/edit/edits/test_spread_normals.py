"""Normals tilted further, or less."""

from __future__ import annotations

import torch

from spmm_torch import SPMM
from spmm_torch.edit import lobe_group, spread_normals
from spmm_torch.edit.edits.spread_normals import tilted
from spmm_torch.geometry.directions import MAX_TILT, hemisphere_spiral
from tests.edit.looks import check_valid


def test_tilts_are_scaled_along_their_azimuth() -> None:
    normal = hemisphere_spiral(64)
    found = tilted(normal, 1.5)
    tilt, after = (torch.arccos(each[:, 2]) for each in (normal, found))
    torch.testing.assert_close(after, (1.5 * tilt).clamp(max=MAX_TILT), atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(found.norm(dim=1), torch.ones(64))
    azimuth, turned = (torch.atan2(each[:, 1], each[:, 0]) for each in (normal, found))
    torch.testing.assert_close(turned, azimuth)
    upright = torch.tensor([[0.0, 0.0, 1.0]])
    assert torch.equal(tilted(upright, 3.0), upright)
    torch.testing.assert_close(tilted(normal, 0.0), upright.expand(64, 3))


def test_spread_and_gathered_normals_return(model: SPMM) -> None:
    back = spread_normals(spread_normals(model, 1.6), 1.0 / 1.6)
    torch.testing.assert_close(back.normal, model.normal)
    assert spread_normals(model, 1.6).weight.data_ptr() == model.weight.data_ptr()
    check_valid(spread_normals(model, 100.0))


def test_spreading_is_kept_to_its_group(model: SPMM) -> None:
    where = lobe_group(model, "specular")
    edited = spread_normals(model, 1.6, where)
    assert where.lobes is not None
    assert torch.equal(edited.normal[~where.lobes], model.normal[~where.lobes])
    assert not torch.equal(edited.normal[where.lobes], model.normal[where.lobes])


def test_identity_changes_nothing(model: SPMM) -> None:
    assert spread_normals(model, 1.0) is model
