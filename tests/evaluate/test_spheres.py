"""The sphere pictures are what their definition says."""

from __future__ import annotations

import math

import pytest
import torch

from spmm_torch.data import BTF
from spmm_torch.evaluate import spheres
from spmm_torch.evaluate.renderings import light_pictures
from spmm_torch.evaluate.spheres import LIGHTS, compare_spheres, sphere_scene
from spmm_torch.geometry.directions import MIRROR
from spmm_torch.model.relief import Relief
from spmm_torch.render import RenderSettings, Texture
from tests.planted.btfs import COARSE_RINGS, tabulated
from tests.planted.materials import Lambertian
from tests.planted.models import FINE_RINGS, planted_model, with_relief

SIZE = 48


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spheres so small that they take no time; the texture is scaled as ever."""
    monkeypatch.setattr(spheres, "SETTINGS", RenderSettings(size=SIZE, samples=1))


def test_a_lambertian_sphere_is_as_bright_as_it_should_be() -> None:
    scene = sphere_scene(Texture())
    pictures = light_pictures(Lambertian((1.0, 0.5, 0.2)), scene, spheres.SETTINGS, "cpu")
    assert pictures.shape == (len(LIGHTS), SIZE, SIZE, 3)
    axis = (2.0 * (torch.arange(SIZE) + 0.5) / SIZE - 1.0) * 1.05
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    z = torch.sqrt((1.0 - x * x - y * y).clamp(min=0.0))
    normal = torch.stack((x, y, z), dim=-1)
    inside = x * x + y * y < 0.8
    for picture, light in zip(pictures, scene.lights, strict=True):
        cosine = (normal @ light.direction.float()).clamp(min=0.0)
        error = (picture[..., 0] - cosine / math.pi)[inside].abs()
        assert float(error.max()) < 0.03  # eye rays are spread over their pixel
        assert float(error.mean()) < 0.005
    torch.testing.assert_close(pictures[..., 1], 0.5 * pictures[..., 0])


def test_a_model_and_its_own_table_look_alike() -> None:
    model = planted_model(2, rings=FINE_RINGS, names=("lambertian", "oren_nayar"))
    found = compare_spheres(model, tabulated(model))
    counted = found.counts[..., None].expand_as(found.original)
    error = (found.original - found.model)[counted].square().mean()
    assert float(error / found.original[counted].square().mean()) < 1e-3
    shown = found.original * found.exposure[:, None, None, None]
    for picture, counts in zip(shown, found.counts, strict=True):
        assert float((picture[counts] > 1.0).float().mean()) == pytest.approx(0.01, abs=0.005)


def test_the_original_continues_by_the_rule_of_the_model() -> None:
    flat = planted_model(2, rings=FINE_RINGS, names=("lambertian", "oren_nayar"))
    mirrored = with_relief(flat, Relief(None, 0.0, 0.0, MIRROR))
    found = compare_spheres(mirrored, tabulated(flat))
    counted = found.counts[..., None].expand_as(found.original)
    error = (found.original - found.model)[counted].square().mean()
    assert float(error / found.original[counted].square().mean()) < 1e-3


def test_pixels_count_where_the_sphere_is_lit() -> None:
    model = planted_model(2, rings=COARSE_RINGS)
    found = compare_spheres(model, tabulated(model))
    parts = [float(counts.float().mean()) for counts in found.counts]
    disk = math.pi / 4.0 / 1.05**2
    for part, (_, angle, _) in zip(parts, LIGHTS, strict=True):
        assert part == pytest.approx(disk * (1.0 + math.cos(math.radians(angle))) / 2.0, rel=0.06)
    assert found.counts[1, SIZE // 4, SIZE // 4]  # light from the upper left
    assert not found.counts[2, SIZE // 2, SIZE // 6]  # light from the right


def counted_reads(btf: BTF, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many texels each later read takes from the BTF, as the list grows."""
    read: list[int] = []
    texels = type(btf).texels

    def counted(self, index, device="cpu"):  # noqa: ANN001, ANN202
        read.append(len(index))
        return texels(self, index, device)

    monkeypatch.setattr(type(btf), "texels", counted)
    return read


def test_little_room_changes_no_value(monkeypatch: pytest.MonkeyPatch) -> None:
    model = planted_model(6, rings=COARSE_RINGS)
    btf = tabulated(model)
    found = compare_spheres(model, btf)
    blocks = counted_reads(btf, monkeypatch)
    narrow = compare_spheres(model, btf, room=1 << 16)
    assert max(blocks) <= (1 << 16) // (2 * 4 * btf.pair_count * 3) < btf.texel_count
    for name in ("original", "model", "lobes"):
        assert torch.equal(getattr(found, name), getattr(narrow, name))


def test_a_large_texture_is_read_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    btf = tabulated(planted_model(2, rings=COARSE_RINGS))
    read = counted_reads(btf, monkeypatch)
    compare_spheres(planted_model(2, rings=COARSE_RINGS), btf)
    assert sum(read) == 4  # all four texels, each once
