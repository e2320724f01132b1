"""What Fig. 10 shows: samples follow the intensity, and its variances are true."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from spmm_torch.figures.hemisphere import (
    glossiest_texel,
    intensity_picture,
    sample_picture,
    texel_centre,
)
from spmm_torch.figures.sampling import _verdict, sphere_hits, variance_gains
from spmm_torch.figures.variance import Efficiency, gain, hits_at, shade_by_sampler, white_light
from spmm_torch.geometry.directions import direction_from_angles, texel_at
from spmm_torch.render import CosineSampled, EnvironmentLight, RenderSettings
from tests.benchmarks.sampling_variance import glossy_model
from tests.planted.materials import Shiny
from tests.planted.models import DIFFUSE, planted_model

SIZE = 64
WO = direction_from_angles(torch.tensor(0.7), torch.tensor(0.4))


def test_dots_lie_where_their_directions_point() -> None:
    wi = direction_from_angles(torch.tensor([1.2]), torch.tensor([math.radians(90.0)]))
    dark = np.argwhere(sample_picture(wi, SIZE).max(-1) < 100)
    row, column = dark.mean(0)
    assert row == pytest.approx(0.5 * (1.0 - math.sin(1.2)) * SIZE, abs=1.0)
    assert column == pytest.approx(0.5 * SIZE, abs=1.0)


def test_intensity_and_samples_agree() -> None:
    model = glossy_model(size=4)
    texel = glossiest_texel(model, WO)
    uv = texel_centre(model, texel)
    index, share = texel_at(uv, 4, 4)
    assert int(index[share.argmax()]) == texel
    blue = 255 - intensity_picture(model, uv, WO, SIZE)[..., 0].astype(int)
    u = torch.rand(2000, 3, generator=torch.Generator().manual_seed(0))
    wi = model.sample(uv.expand(2000, 2), WO.expand(2000, 3), u)[0]
    column = (0.5 * (1.0 + wi[:, 0]) * SIZE).long().clamp(max=SIZE - 1)
    row = (0.5 * (1.0 - wi[:, 1]) * SIZE).long().clamp(max=SIZE - 1)
    assert blue[row, column].mean() > 2.0 * blue[blue > 0].mean()


def test_the_glossiest_texel_is_not_the_brightest() -> None:
    model = planted_model(4, 1, 2, 2, names=("lambertian", "ward"))
    model.weight.data[:] = 1.0
    glossy = model.lobe_model == model.lobe_model.max()
    model.weight.data[glossy[model.index]] = 0.1
    model.kappa.data[glossy, :2] = 0.03
    assert bool(glossy[model.index[glossiest_texel(model, WO)]])


def test_both_samplers_estimate_the_same_light() -> None:
    material, hits = Shiny(), hits_at(torch.tensor([0.5, 0.5]), WO)
    found = [
        shade_by_sampler(each, hits, white_light(), 200_000, 1)
        for each in (material, CosineSampled(material))
    ]
    expected = math.pi * 0.2 + 2.0 * math.pi * 2.0 / 41.0
    for radiance, _ in found:
        assert radiance[0].tolist() == pytest.approx([expected] * 3, rel=0.01)
    ours, cosine = (efficiency for _, efficiency in found)
    # Variance of value / pdf under cosine sampling, in closed form.
    z_moments = 0.2**2 / 2 + 2 * 0.2 * 2 / 41 + 2.0**2 / 80
    exact = 2.0 * math.pi * math.pi * z_moments - expected**2
    assert cosine.variance == pytest.approx(exact, rel=0.02)
    assert gain(ours, cosine).equal_count > 2.0


def test_gains() -> None:
    ours, other = Efficiency(2.0, 3.0), Efficiency(40.0, 1.0)
    assert gain(ours, other).equal_count == 20.0
    assert gain(ours, other).equal_time == pytest.approx(20.0 / 3.0)


def test_glossy_materials_gain_and_diffuse_ones_do_not() -> None:
    gains = {}
    for name, model in (
        ("glossy", glossy_model(size=4)),
        ("diffuse", planted_model(4, names=DIFFUSE)),
    ):
        hits = sphere_hits(model, RenderSettings(10, 1))
        gains[name] = variance_gains(model, hits, white_light(), 128, 0)["gain"]["equal_count"]
    assert gains["glossy"] > 20.0
    assert gains["diffuse"] == pytest.approx(1.0, abs=0.3)


def test_the_studio_is_sampled_too() -> None:
    hits = sphere_hits(glossy_model(size=4), RenderSettings(12, 1))
    studio = EnvironmentLight.studio().to("cpu", torch.float32)
    assert variance_gains(glossy_model(size=4), hits, studio, 64, 0)["gain"]["equal_count"] > 1.0


def test_the_caption_says_whether_sampling_gains() -> None:
    gains = {"equal_count": 1.04, "equal_time": 0.8}
    assert "This material is matt" in _verdict(gains, gains)
    gains = {"equal_count": 20.0, "equal_time": 10.0}
    assert "lower by a factor of 10.0 at equal time and 20.0" in _verdict(gains, gains)
