"""The pictures that a report opens with."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.evaluate import opening_section, planes, spheres
from spmm_torch.evaluate.opening import NAMES
from spmm_torch.evaluate.planes import compare_planes
from spmm_torch.evaluate.spheres import compare_spheres
from spmm_torch.render import RenderSettings
from spmm_torch.report.views import Gallery, Picture
from tests.planted.btfs import COARSE_RINGS, measured, tabulated
from tests.planted.models import planted_model, with_residual


@pytest.fixture(scope="module")
def gallery() -> Gallery:
    """The opening of a model with a residual, and of its own table."""
    with pytest.MonkeyPatch.context() as patch:
        for part in (spheres, planes):
            patch.setattr(part, "SETTINGS", RenderSettings(size=48, samples=2))
        model = with_residual(6)
        btf = measured(model)
        return opening_section(compare_spheres(model, btf), compare_planes(model, btf))


def codes(picture: Picture) -> np.ndarray:
    content = base64.b64decode(picture.uri.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(content))).astype(int)


def figure(picture: Picture, name: str) -> float:
    (found,) = re.findall(rf"{name} ([\d.]+)", picture.caption)
    return float(found)


def test_both_shapes_stand_under_both_lights(gallery: Gallery) -> None:
    assert [row.title for row in gallery.rows] == [
        "Sphere, light from the camera",
        "Sphere, grazing light, right",
        "Plane, light from above",
        "Plane, grazing light, right",
    ]
    alternatives = [picture.alternative for row in gallery.rows for picture in row.pictures]
    assert len(set(alternatives)) == len(alternatives) == 4 * len(NAMES)


def test_rows_hold_original_model_and_lobes(gallery: Gallery) -> None:
    for row in gallery.rows:
        original, model, lobes = row.pictures
        assert tuple(picture.caption.split(" ·")[0] for picture in row.pictures) == NAMES
        assert original.caption == NAMES[0]
        assert figure(model, "PSNR") > figure(lobes, "PSNR")
        sizes = {codes(picture).shape for picture in row.pictures}
        assert len(sizes) == 1
        near = np.abs(codes(original) - codes(model)).mean()
        assert near < np.abs(codes(original) - codes(lobes)).mean()


def test_flip_stands_beside_psnr(gallery: Gallery) -> None:
    pytest.importorskip("flip_evaluator", reason="needs the extra eval")
    for row in gallery.rows:
        _, model, lobes = row.pictures
        assert 0.0 <= figure(model, "FLIP") < figure(lobes, "FLIP") < 1.0


def test_the_plane_is_seen_at_an_angle_and_fills_its_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(planes, "SETTINGS", RenderSettings(size=64, samples=2))
    model = planted_model(2, rings=COARSE_RINGS)
    found = compare_planes(model, tabulated(model))
    _, height, width, _ = found.original.shape
    assert height / width == pytest.approx(np.cos(np.deg2rad(planes.VIEW[0])), abs=0.05)
    assert float(found.counts.float().mean()) > 0.98
    assert bool((found.original[:, height // 2].amax(-1) > 0.0).all())


def test_a_large_texture_is_seen_from_near(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle of it, `TEXELS_ACROSS` texels wide."""
    monkeypatch.setattr(planes, "SETTINGS", RenderSettings(size=32, samples=1))
    monkeypatch.setattr(planes, "TEXELS_ACROSS", 3)
    model = planted_model(6, rings=COARSE_RINGS)
    btf = tabulated(model)
    read: set[int] = set()
    texels = type(btf).texels

    def counted(self, index, device="cpu"):  # noqa: ANN001, ANN202
        read.update(index.tolist() if isinstance(index, torch.Tensor) else [])
        return texels(self, index, device)

    monkeypatch.setattr(type(btf), "texels", counted)
    compare_planes(model, btf)
    columns = {texel % 6 for texel in read}
    assert columns == {1, 2, 3, 4}
