"""The editor's pictures are the model's, whatever is kept between edits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.config.render import RenderSettings
from spmm_torch.edit import (
    hue_saturation,
    intensity,
    lobe_group,
    relief_depth,
    residual_strength,
    scale_width,
    select_texels,
    spread_normals,
)
from spmm_torch.errors import ConfigError
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.render import DirectionalLight
from spmm_torch.render.camera import Camera
from spmm_torch.render.renderer import Scene, render
from spmm_torch.render.shapes import Rays, Sphere, Texture
from spmm_torch.viz.editor.drape import Drape, height
from spmm_torch.viz.editor.lobe_cache import Stopped
from spmm_torch.viz.editor.preview import Preview, selection_codes
from spmm_torch.viz.editor.stage import HALF_WIDTH, SHAPES, Setting, Stage, first_setting
from spmm_torch.viz.palette import PAGE
from tests.planted.models import planted_model, with_components, with_relief

SETTING = Setting(light=(40.0, 30.0), view=(20.0, -50.0))


@pytest.fixture(params=["clusters", "components"])
def model(request: pytest.FixtureRequest) -> SPMM:
    """With a residual of clusters, or of rank R."""
    planted = planted_model(size=16, residual=0.02)
    if request.param == "components":
        planted = with_components(planted, size=0.02)
    return planted.requires_grad_(False)


def masked(model: SPMM) -> SPMM:
    """Lobes that are edited in a part of the texture: another structure."""
    mask = torch.zeros(model.height, model.width)
    mask[:, 5:11] = 1.0
    where = select_texels(model, mask) & lobe_group(model, "specular")
    return scale_width(model, 0.5, where)


EDITS: dict[str, Callable[[SPMM], SPMM]] = {
    "intensity": lambda model: intensity(model, 1.7),
    "hue": lambda model: hue_saturation(model, 1.0, 1.2),
    "width": lambda model: scale_width(model, 0.6, lobe_group(model, "specular")),
    "normals": lambda model: spread_normals(model, 1.8),
    "residual": lambda model: residual_strength(model, 0.3),
    "masked": masked,
}


def test_a_smooth_picture_is_that_of_the_renderer(model: SPMM) -> None:
    """One ray tells as much as many where the texture has a single texel."""
    flat = planted_model(size=1, residual=0.02).requires_grad_(False)
    picture = Stage(flat, SETTING, 20, smooth=True).picture(flat)
    angles = torch.deg2rad(torch.tensor([[40.0, 30.0], [20.0, -50.0]], dtype=torch.float64))
    light = DirectionalLight.build(direction_from_angles(*angles[0]).tolist())
    camera = Camera.orthographic(*angles[1].tolist(), HALF_WIDTH)
    expected = render(flat, Scene(Sphere(Texture(1.0)), camera, (light,)), RenderSettings(20, 16))
    inner = expected.coverage == 1.0
    difference = (picture - expected.picture).abs()[inner]
    assert float(difference.median()) < 0.02 * float(expected.picture.max())


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_kept_values_are_those_that_are_computed_anew(
    model: SPMM, edit: Callable[[SPMM], SPMM], smooth: bool
) -> None:
    kept = Stage(model, SETTING, 32, smooth)
    before = kept.picture(model)
    edited = edit(model)
    after = kept.picture(edited)
    assert torch.equal(after, Stage(model, SETTING, 32, smooth).picture(edited))
    assert not torch.equal(after, before)
    assert torch.equal(kept.picture(model), before)


@pytest.mark.parametrize("smooth", [False, True])
def test_pictures_follow_the_relief(model: SPMM, smooth: bool) -> None:
    rough = with_relief(model).requires_grad_(False)
    kept = Stage(rough, SETTING, 32, smooth)
    before = kept.picture(rough)
    deeper = relief_depth(rough, 2.0)
    after = kept.picture(deeper)
    assert torch.equal(after, Stage(deeper, SETTING, 32, smooth).picture(deeper))
    assert not torch.equal(after, before)
    assert torch.equal(kept.picture(rough), before)
    assert kept.stale(intensity(rough, 2.0)) == 0


def test_edits_of_weights_evaluate_no_lobe(model: SPMM) -> None:
    stage = Stage(model, SETTING, 32)
    assert stage.stale(model) > 0
    stage.picture(model)
    for name in ("intensity", "hue", "residual"):
        assert stage.stale(EDITS[name](model)) == 0
    specular = stage.stale(EDITS["width"](model))
    assert 0 < specular < stage.stale(EDITS["normals"](model))


def test_texel_centres_of_a_plane_are_the_model(model: SPMM) -> None:
    setting = Setting("plane", light=(30.0, 10.0), view=(0.0, 0.0))
    picture = Stage(model, setting, 64).picture(model)
    theta, phi = torch.deg2rad(torch.tensor([30.0, 10.0], dtype=torch.float64))
    wi = direction_from_angles(theta, phi).float()
    wo = torch.tensor([0.0, 0.0, 1.0])
    texels = model.picture(wi, wo).clamp(min=0.0)
    at = ((torch.arange(16) + 0.5) / 16 * 2.0 - 1.0) / HALF_WIDTH  # middles of texels, -1 to 1
    pixel = ((at + 1.0) / 2.0 * 64).long()
    assert torch.allclose(picture[pixel[:, None], pixel], texels, atol=1e-5)


def test_an_unwanted_picture_is_given_up_and_changes_nothing(model: SPMM) -> None:
    stage = Stage(model, SETTING, 32)
    before = stage.picture(model)
    with pytest.raises(Stopped):
        stage.picture(EDITS["normals"](model), stop=lambda: True)
    assert stage.stale(model) == 0
    assert torch.equal(stage.picture(model), before)


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_cover_what_they_should(model: SPMM, shape: str) -> None:
    stage = Stage(model, Setting(shape, view=(0.0, 0.0)), 64)
    whole = {"sphere": math.pi / 4.0, "cloth": 1.0, "plane": 1.0}[shape] / HALF_WIDTH**2
    assert float(stage.coverage.mean()) == pytest.approx(whole, rel=0.05)
    assert bool(((stage.coverage >= 0.0) & (stage.coverage <= 1.0)).all())


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"shape": "cube"}, "shape is 'cube'; expected one of sphere, cloth, plane"),
        ({"repeat": 0.0}, "repeat is 0.0; expected a positive number"),
        ({"light": (200.0, 0.0)}, "light is 200.0, 0.0; expected theta from 0 to 180"),
    ],
)
def test_wrong_settings_are_refused(options: dict, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        Setting(**options)


def test_small_textures_are_repeated(model: SPMM) -> None:
    assert first_setting(model).repeat == 8.0


def test_rays_meet_the_cloth_at_its_height() -> None:
    generator = torch.Generator().manual_seed(1)
    origin = torch.rand(400, 3, generator=generator) - 0.5
    origin[:, 2] = 4.0
    direction = torch.tensor([0.1, -0.05, -1.0]).expand(400, 3)
    direction = direction / direction.norm(dim=-1, keepdim=True)
    drape = Drape(Texture())
    distance = drape.distance(Rays(origin, direction))
    assert bool(torch.isfinite(distance).all())
    at = origin + distance[:, None] * direction
    assert torch.allclose(at[:, 2], height(at[:, 0], at[:, 1]), atol=2e-4)


def test_frames_of_the_cloth_are_its_slopes() -> None:
    x = torch.linspace(-0.9, 0.9, 50, dtype=torch.float64)
    y = torch.linspace(0.8, -0.7, 50, dtype=torch.float64)
    position = torch.stack((x, y, height(x, y)), dim=-1)
    frame, uv = Drape(Texture()).surface(position)
    eye = torch.eye(3, dtype=torch.float64).expand(50, 3, 3)
    assert torch.allclose(frame @ frame.transpose(1, 2), eye, atol=1e-9)
    step = 1e-6
    slope = (height(x + step, y) - height(x - step, y)) / (2.0 * step)
    tangent = frame[:, 0]
    assert torch.allclose(tangent[:, 2] / tangent[:, 0], slope, atol=1e-6)
    assert torch.allclose(uv, torch.stack((x, y), dim=-1) / 2.0 + 0.5)


def test_previews_show_the_page_beside_the_shape(model: SPMM) -> None:
    preview = Preview(model, SETTING, 48)
    page = np.round(255.0 * np.array(PAGE))
    for codes in (preview.original, preview.follow(model), preview.finish(model)):
        assert np.abs(codes[0, 0] - page).max() <= 1.0
        assert codes[20:28, 20:28].std() > 0.0


def test_a_preview_too_heavy_is_coarse_first(model: SPMM) -> None:
    preview = Preview(model, SETTING, 48)
    preview._pace = 1.0
    edited = EDITS["normals"](model)
    coarse, fine = preview.follow(edited), preview.finish(edited)
    preview._pace = 0.0
    sharp = preview.follow(edited)
    assert not np.array_equal(coarse, sharp)
    assert np.abs(coarse.astype(float) - fine).mean() < 30.0


def test_what_is_selected_is_tinted(model: SPMM) -> None:
    plain = selection_codes(model, None)
    share = torch.zeros(256)
    share[:16] = 1.0
    tinted = selection_codes(model, share)
    assert np.array_equal(tinted[1:], plain[1:])
    assert not np.array_equal(tinted[0], plain[0])
