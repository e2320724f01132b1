"""The raw BTF as a material: measured values where measured, and close to a model's in between."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from spmm_torch import BTF, load_btf
from spmm_torch.data import sample_path
from spmm_torch.geometry.directions import UBO2003_RINGS, ring_directions
from spmm_torch.render import (
    BTFMaterial,
    Camera,
    DirectionalLight,
    Plane,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from tests.planted.btfs import random_btf, tabulated
from tests.planted.models import DIFFUSE, FINE_RINGS, GLOSSY, planted_model

HEIGHT, WIDTH = 3, 5
LIGHT = ring_directions(((0.0, 1), (40.0, 6), (70.0, 9)))
VIEW = ring_directions(((0.0, 1), (50.0, 7)))


@pytest.fixture
def btf() -> BTF:
    return random_btf(LIGHT, HEIGHT, WIDTH, VIEW)


def centre(row: int, column: int) -> torch.Tensor:
    return torch.tensor([(column + 0.5) / WIDTH, 1.0 - (row + 0.5) / HEIGHT])


def test_measured_values_are_returned(btf: BTF) -> None:
    material = BTFMaterial.build(btf)
    wi, wo = btf.pairs()
    for row, column in ((0, 0), (2, 4), (1, 3)):
        found = material(centre(row, column), wi, wo)
        expected = btf.texels(torch.tensor([row * WIDTH + column]))[0]
        torch.testing.assert_close(found, expected, atol=2e-5, rtol=0.0)


def test_bilinear_and_repeating(btf: BTF) -> None:
    material = BTFMaterial.build(btf)
    wi, wo = LIGHT[3], VIEW[2]
    picture = btf.picture(2, 3)
    between = 0.25 * centre(0, 1) + 0.75 * centre(0, 2)
    expected = 0.25 * picture[0, 1] + 0.75 * picture[0, 2]
    torch.testing.assert_close(material(between, wi, wo), expected, atol=2e-5, rtol=0.0)
    edge = torch.tensor([0.0, float(centre(1, 0)[1])])
    expected = 0.5 * (picture[1, 0] + picture[1, -1])
    torch.testing.assert_close(material(edge, wi, wo), expected, atol=2e-5, rtol=0.0)
    torch.testing.assert_close(
        material(between + torch.tensor([3.0, -2.0]), wi, wo), material(between, wi, wo)
    )


def test_below_the_lowest_ring_light_fades(btf: BTF) -> None:
    material = BTFMaterial.build(btf)
    low, lower, under = (
        torch.tensor([math.sin(math.radians(a)), 0.0, math.cos(math.radians(a))])
        for a in (70.0, 85.0, 95.0)
    )
    at = centre(1, 1)
    edge = material(at, low, VIEW[0])
    ratio = math.cos(math.radians(85.0)) / math.cos(math.radians(70.0))
    torch.testing.assert_close(material(at, lower, VIEW[0]), ratio * edge, atol=1e-4, rtol=0.0)
    assert bool((material(at, under, VIEW[0]) == 0.0).all())
    assert bool((material(at, LIGHT[0], under) == 0.0).all())


def test_shapes_broadcast_and_blocks_change_nothing(btf: BTF) -> None:
    material = BTFMaterial.build(btf)
    uv = torch.rand(6, 1, 2, generator=torch.Generator().manual_seed(1))
    whole = material(uv, LIGHT[:4], VIEW[1])
    assert whole.shape == (6, 4, 3)
    torch.testing.assert_close(whole[2, 3], material(uv[2, 0], LIGHT[3], VIEW[1]))
    in_blocks = replace(material, texel_values=1, picked_values=81)
    torch.testing.assert_close(in_blocks(uv, LIGHT[:4], VIEW[1]), whole)
    assert material(uv[:0], LIGHT[:4], VIEW[1]).shape == (0, 4, 3)


def test_each_texel_is_read_once(btf: BTF, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []

    def texels(self: BTF, index: torch.Tensor, device: str) -> torch.Tensor:
        read.extend(index.tolist())
        return whole(self, index, device)

    whole = BTF.texels
    monkeypatch.setattr(BTF, "texels", texels)
    uv = torch.rand(300, 2, generator=torch.Generator().manual_seed(2))
    material = replace(BTFMaterial.build(btf), texel_values=4 * btf.pair_count * 3)
    material(uv, LIGHT[1], VIEW[1])
    assert read == list(range(HEIGHT * WIDTH))


def test_the_cache_renders_the_same(tmp_path: Path) -> None:
    scene = Scene(Sphere(), Camera.orthographic(), (DirectionalLight.build((1.0, 1.0, 2.0)),))
    settings = RenderSettings(size=24, samples=1)
    memory, disk = load_btf(sample_path()), load_btf(sample_path())
    disk.load(cache=tmp_path)
    assert list(tmp_path.glob("*.npy"))
    pictures = [render(BTFMaterial.build(btf), scene, settings).picture for btf in (memory, disk)]
    assert torch.equal(*pictures)
    assert float(pictures[0].max()) > 0.1


def test_model_and_its_table_agree_where_measured() -> None:
    """On a plane under measured directions nothing is interpolated but texels, by both alike."""
    model = planted_model()
    theta, phi = math.radians(30.0), math.radians(60.0)
    light = DirectionalLight.build(model.light[40].tolist(), (1.0, 2.0, 3.0))
    camera = Camera.orthographic(theta, phi)
    assert float((model.view.double() @ camera.axes[2]).max()) == pytest.approx(1.0)
    scene = Scene(Plane(Texture(2.0)), camera, (light,))
    settings = RenderSettings(size=32, samples=2)
    pictures = [
        render(m, scene, settings).picture for m in (model, BTFMaterial.build(tabulated(model)))
    ]
    torch.testing.assert_close(*pictures, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("names", "limit"), [(DIFFUSE, 0.025), (DIFFUSE + GLOSSY, 0.4)])
def test_model_and_its_table_agree_to_the_interpolation_error(
    names: tuple[str, ...], limit: float
) -> None:
    """On a sphere they differ as a linear interpolation does: less on finer rings."""
    lights = tuple(DirectionalLight.build(d) for d in ((1.0, 1, 2), (-1.0, 0.5, 2), (0.0, -1, 3)))
    scene = Scene(Sphere(Texture(2.0)), Camera.orthographic(), lights)
    settings = RenderSettings(size=48, samples=2)
    errors = []
    for rings in (UBO2003_RINGS, FINE_RINGS):
        model = planted_model(rings=rings, names=names)
        truth = render(model, scene, settings).picture
        found = render(BTFMaterial.build(tabulated(model)), scene, settings).picture
        errors.append(float((found - truth).norm() / truth.norm()))
    assert errors[0] < limit
    assert errors[1] < 0.75 * errors[0]


def test_missing_pairs_leave_their_share_to_the_others() -> None:
    """Of a constant BTF the values stay the same, but where nothing around was measured."""
    directions = ring_directions(((0.0, 1), (40.0, 6)))
    count = len(directions)
    missing = torch.zeros(count, count, dtype=torch.bool)
    missing[0, 0] = missing[2, 3] = True
    values = (~missing).float()[..., None, None, None].expand(count, count, 2, 2, 3)
    btf = BTF.from_values(values.contiguous(), directions, directions)
    btf.missing = missing
    material = BTFMaterial.build(btf)
    wi = torch.nn.functional.normalize(directions[[0, 3]] + 0.1 * directions[[1, 4]], dim=1)
    wo = torch.nn.functional.normalize(directions[[0, 2]] + 0.1 * directions[[2, 3]], dim=1)
    uv = torch.full((2, 2), 0.5)
    torch.testing.assert_close(material(uv, wi, wo), torch.ones(2, 3))
    at_the_gap = material(uv[:1], directions[:1], directions[:1])
    torch.testing.assert_close(at_the_gap, torch.zeros(1, 3))


@pytest.mark.gpu
def test_gpu_gives_the_same_values(btf: BTF) -> None:
    generator = torch.Generator().manual_seed(4)
    uv, pick = (
        torch.rand(500, 2, generator=generator),
        torch.randint(7, (500,), generator=generator),
    )
    wi = torch.nn.functional.normalize(LIGHT[pick] + 0.2 * LIGHT[pick + 1], dim=1)
    wo = torch.nn.functional.normalize(VIEW[pick] + 0.1 * VIEW[(pick + 1) % 8], dim=1)
    host = BTFMaterial.build(btf)(uv, wi, wo)
    device = BTFMaterial.build(btf, "cuda")(uv.cuda(), wi.cuda(), wo.cuda())
    torch.testing.assert_close(device.cpu(), host, atol=1e-4, rtol=1e-4)
