"""A picture of everything at once against one that was made before, with a tolerance.

`python -m tests.render.test_regression` makes the reference anew, with many more samples.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch

from spmm_torch.data.codecs import openexr
from spmm_torch.render import (
    Camera,
    CosineSampled,
    DirectionalLight,
    EnvironmentLight,
    PointLight,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from tests.planted.models import DIFFUSE, planted_model

REFERENCE = Path(__file__).with_name("reference.exr")
SIZE, SAMPLES, REFERENCE_SAMPLES = 40, 36, 400
# Relative error of the whole picture; the noise that is left at SAMPLES is 0.02.
TOLERANCE = 0.04


def picture(samples: int) -> torch.Tensor:
    """A glossy sphere under lights with a direction, and a diffuse one in the studio."""
    lights = (
        DirectionalLight.build((1.0, 1.0, 2.0), (1.0, 0.9, 0.7)),
        PointLight.build((-2.0, 0.5, 2.0), (2.0, 3.0, 5.0)),
    )
    camera = Camera.perspective(math.radians(20.0), math.radians(70.0))
    settings = RenderSettings(SIZE, samples)
    glossy, diffuse = planted_model(residual=0.02), planted_model(names=DIFFUSE)
    pairs = ((glossy, lights), (CosineSampled(diffuse), (EnvironmentLight.studio(),)))
    scenes = [(material, Scene(Sphere(Texture(1.5)), camera, given)) for material, given in pairs]
    pictures = [render(material, scene, settings).picture for material, scene in scenes]
    return torch.cat(pictures, dim=1)


def test_picture_is_as_it_was() -> None:
    expected = torch.from_numpy(openexr.decode(REFERENCE.read_bytes())).float()
    error = (picture(SAMPLES) - expected).norm() / expected.norm()
    assert float(error) < TOLERANCE


if __name__ == "__main__":
    REFERENCE.write_bytes(openexr.encode(picture(REFERENCE_SAMPLES).half().numpy()))
