"""Values read where each view shows the point of the surface, against explicit lookups."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, load_btf
from spmm_torch.data import write_npz
from spmm_torch.geometry.directions import REPEAT, RULES, direction_from_angles, ring_directions
from spmm_torch.geometry.relief import HeightField, texel_centres

VIEW = ring_directions(((0.0, 1), (35.0, 4), (60.0, 5)))
LIGHT = ring_directions(((20.0, 2), (50.0, 3)))
HEIGHT, WIDTH = 5, 7


def pictures(view: Tensor = VIEW, size: tuple[int, int] = (HEIGHT, WIDTH)) -> BTF:
    shape = (len(view), len(LIGHT), *size, 3)
    values = torch.rand(shape, generator=torch.Generator().manual_seed(1))
    return BTF.from_values(values, view, LIGHT)


def random_field(rule: str = REPEAT) -> HeightField:
    generator = torch.Generator().manual_seed(2)
    return HeightField(0.3 * torch.rand(HEIGHT, WIDTH, generator=generator) - 0.1, rule, slope=2.0)


def random_drift() -> Tensor:
    return 0.3 * torch.rand(len(VIEW), 2, generator=torch.Generator().manual_seed(3)) - 0.15


def explicit(btf: BTF, field: HeightField, drift: Tensor | None) -> Tensor:
    """Values `[T, V, L, C]`, a texel and a view at a time."""
    found = torch.zeros(btf.texel_count, len(btf.view), len(btf.light), 3)
    centres = texel_centres(btf.height, btf.width, btf.view)
    for v, view in enumerate(btf.view):
        planes = btf.pictures(v)  # [L, H, W, C]
        for texel, centre in enumerate(centres):
            at = field.place(centre, view) - (0.0 if drift is None else drift[v])
            column = continued(math.floor(at[0] * btf.width), btf.width, field)
            row = continued(math.floor((1.0 - at[1]) * btf.height), btf.height, field)
            found[texel, v] = planes[:, row, column]
    return found


def continued(index: int, count: int, field: HeightField) -> int:
    copy, within = divmod(index, count)
    return count - 1 - within if field.rule != REPEAT and copy % 2 else within


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("drifts", [False, True])
def test_values_are_those_of_the_nearest_pixels(rule: str, drifts: bool) -> None:
    btf, field, drift = pictures(), random_field(rule), random_drift() if drifts else None
    aligned = btf.aligned(field, drift)
    expected = explicit(btf, field, drift).flatten(1, 2)
    torch.testing.assert_close(aligned.texels(), expected, rtol=1e-4, atol=1e-5)


def test_all_ways_to_read_agree() -> None:
    aligned = pictures().aligned(random_field("mirror"), random_drift())
    whole = aligned.texels()
    some = torch.tensor([8, 3, 3, 30])
    mask = torch.zeros(aligned.texel_count, dtype=torch.bool)
    mask[[2, 9]] = True
    for index in (some, mask, slice(4, 9)):
        assert torch.equal(aligned.texels(index), whole[index])
        assert torch.equal(aligned.signals(index), whole[index].transpose(1, 2))
    assert torch.equal(aligned.views(2, 4).flatten(1, 2), whole[:, 10:20])
    assert torch.equal(aligned.picture(3, 1).flatten(0, 1), whole[:, 16])
    strips = aligned.store().strips(some, torch.tensor([0, 7, 2, 9]), len(LIGHT), "cpu")
    expected = whole.unflatten(1, (len(VIEW), -1))[some, torch.tensor([0, 7, 2, 9])]
    assert torch.equal(strips, expected)


def test_a_plane_of_whole_texels_rolls_the_pictures() -> None:
    """Views with |wo_xy| = wo_z over a height of two texels show everything two texels off."""
    polar, azimuth = torch.full((4,), torch.pi / 4), torch.arange(4) * torch.pi / 2
    view = direction_from_angles(polar, azimuth).float()
    btf = pictures(view, (6, 6))
    field = HeightField(torch.full((6, 6), 2.0 / 6.0), REPEAT, slope=2.0)
    aligned = btf.aligned(field)
    for number, (right, up) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        before, after = btf.pictures(number), aligned.pictures(number)
        rolled = before.roll((-2 * up, 2 * right), dims=(1, 2))
        torch.testing.assert_close(after, rolled, rtol=1e-4, atol=1e-5)


def test_no_heights_change_nothing() -> None:
    btf = pictures()
    field = HeightField(torch.zeros(HEIGHT, WIDTH), REPEAT, slope=2.0)
    torch.testing.assert_close(btf.aligned(field).texels(), btf.texels(), rtol=1e-5, atol=1e-6)


def test_what_is_known_of_the_pictures_stays_known() -> None:
    btf = pictures()
    gaps = torch.zeros(len(VIEW), len(LIGHT), dtype=torch.bool)
    gaps[1, 2] = True
    aligned = replace(btf, missing=gaps).aligned(random_field())
    assert aligned.measured_count == btf.pair_count - 1
    assert (aligned.height, aligned.width, aligned.is_hdr) == (HEIGHT, WIDTH, False)
    assert aligned.texels().shape == btf.texels().shape


def test_values_on_disk_are_read_alike(tmp_path: Path) -> None:
    btf, field, drift = pictures(), random_field(), random_drift()
    expected = btf.aligned(field, drift).texels()
    path = tmp_path / "values.npz"
    write_npz(path, btf)
    kept = load_btf(path).load(memory=0, cache=tmp_path / "cache")
    assert any((tmp_path / "cache").iterdir())
    some = torch.tensor([30, 1, 17])
    torch.testing.assert_close(kept.aligned(field, drift).texels(), expected, rtol=0, atol=1e-3)
    found = kept.aligned(field, drift).texels(some)
    torch.testing.assert_close(found, expected[some], rtol=0, atol=1e-3)
