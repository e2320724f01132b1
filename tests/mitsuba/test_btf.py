"""The plug-in `btf` against the material of our renderer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch import BTF
from spmm_torch.data import write_npz
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.mitsuba import measured
from spmm_torch.render import BTFMaterial
from tests.mitsuba.queries import interaction, random_queries, values, vectors
from tests.planted.btfs import random_btf

LIGHT = ring_directions(((0.0, 1), (40.0, 6), (70.0, 9)))
VIEW = ring_directions(((0.0, 1), (50.0, 7)))
QUERIES = 2_000


def with_gaps(btf: BTF) -> BTF:
    """The BTF without every seventh pair."""
    missing = torch.arange(btf.pair_count) % 7 == 3
    return replace(btf, missing=missing.view(len(btf.view), len(btf.light)))


@pytest.mark.parametrize(
    ("change", "halves"),
    [
        pytest.param(with_gaps, False, id="gaps"),
        pytest.param(lambda btf: btf, False, id="whole", marks=pytest.mark.slow),
        pytest.param(with_gaps, True, id="gaps-halves", marks=pytest.mark.slow),
    ],
)
def test_values_are_those_of_the_material(
    change: Any, halves: bool, mi: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "SINGLE_VALUES", 0 if halves else measured.SINGLE_VALUES)
    btf = change(random_btf(LIGHT, 3, 5, VIEW))
    reflector = measured.Measured(btf)
    uv, wi, wo = random_queries(QUERIES)
    seen = reflector.seen(mi.Point2f(*uv.T.contiguous().numpy()), vectors(mi, wo))
    found, _ = reflector.evaluated(seen, vectors(mi, wi))
    expected = BTFMaterial.build(btf)(uv, wi, wo)
    tolerance = 5e-4 if halves else 1e-5
    torch.testing.assert_close(values(found), expected, rtol=tolerance, atol=tolerance)


def test_the_plugin_reads_a_file(mi: Any, tmp_path: Path) -> None:
    btf = random_btf(LIGHT, 3, 5, VIEW)
    write_npz(tmp_path / "x.npz", btf)
    bsdf = mi.load_dict({"type": "btf", "filename": str(tmp_path / "x.npz")})
    uv, wi, wo = random_queries(QUERIES)
    found, density = bsdf.eval_pdf(mi.BSDFContext(), interaction(mi, uv, wo), vectors(mi, wi))
    expected = BTFMaterial.build(btf)(uv, wi, wo)
    torch.testing.assert_close(values(found), expected, rtol=1e-3, atol=1e-3)  # pictures of 16 bit
    torch.testing.assert_close(values(density), wi[:, 2] / torch.pi)
