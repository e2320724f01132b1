"""Surfaces: planted ones are found again, energy is kept, and textures are read as renderers do."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.export.loss import random_queries
from spmm_torch.export.surface.fit import (
    Look,
    fit_parameters,
    fit_surface,
    gain_note,
    look_of,
    parameters_of,
    random_pairs,
    shown,
)
from spmm_torch.export.surface.gltf import GLTFSurface
from spmm_torch.export.surface.openpbr import OpenPBRSurface
from spmm_torch.export.surface.parameters import Surface, joined, split, start_of
from spmm_torch.export.surface.textured import Textured
from spmm_torch.geometry.warp import square_to_uniform_hemisphere
from spmm_torch.runtime.progress import Progress
from tests.planted.models import planted_model

QUIET = Progress(enabled=False)
SURFACES = [GLTFSurface(), OpenPBRSurface()]
TEXELS = 4
FAST = ("specular", "fuzz")


def planted(surface: Surface, texels: int, layers: tuple[str, ...]) -> dict[str, Tensor]:
    """Random parameters, away from the ends of their ranges."""
    parameters = parameters_of(surface, layers)
    generator = torch.Generator().manual_seed(4)
    size = sum(each.size for each in parameters)
    units = 0.3 + 0.4 * torch.rand(texels, size, generator=generator)
    return split(units, parameters)


def looking(surface: Surface, values: dict[str, Tensor]) -> Look:
    """The look of a surface."""
    wi, wo = random_pairs(torch.ones(1))
    value = surface.eval(values, wi, wo)
    return Look(wi, wo, value, float(value.max()), 1.0)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_planted_surface_is_found(surface: Surface) -> None:
    values = planted(surface, 8, ())
    look = looking(surface, values)
    start = start_of(surface.core, 8, look.value)
    found, error = fit_parameters(surface, surface.core, look, start, steps=300)
    assert float(error.mean()) < 1e-4
    torch.testing.assert_close(found["normal"], values["normal"], atol=0.03, rtol=0)
    rough = next(name for name in found if name.endswith("roughness"))
    torch.testing.assert_close(found[rough], values[rough], atol=0.05, rtol=0)
    value = surface.eval(found, look.wi, look.wo)
    torch.testing.assert_close(value.mean(1), look.value.mean(1), atol=5e-3, rtol=0.02)


@pytest.mark.parametrize(
    ("surface", "layer"),
    [
        pytest.param(surface, layer, marks=() if layer in FAST else pytest.mark.slow)
        for surface in SURFACES
        for layer in surface.layers
    ],
)
def test_a_layer_that_is_there_pays(surface: Surface, layer: str) -> None:
    values = planted(surface, TEXELS, (layer,))
    if layer == "anisotropy":
        values["anisotropy"] = torch.tensor([[-0.7, 0.5]]).expand(TEXELS, 2)
    if layer == "specular":
        values["specular_color"] = torch.tensor([[0.5, 8.0, 2.0]]).expand(TEXELS, 3)
    assert layer in fit_surface(surface, looking(surface, values), QUIET).layers


@pytest.mark.parametrize("surface", SURFACES)
def test_no_surface_reflects_more_than_it_gets(surface: Surface) -> None:
    """Except for the few hundredths by which albedos of layers are off."""
    points = torch.quasirandom.SobolEngine(2).draw(1 << 12)
    wi = square_to_uniform_hemisphere(points)
    wo = torch.nn.functional.normalize(torch.tensor([0.4, 0.2, 0.7]), dim=0).expand_as(wi)
    values = planted(surface, 20, tuple(surface.layers))
    values["normal"] = torch.zeros(20, 2)
    for name in values:
        if "color" in name:
            values[name] = torch.ones(20, 3)
    albedo = 2.0 * torch.pi * surface.eval(values, wi.T, wo.T).mean(1)
    assert float(albedo.max()) < 1.06
    assert float(albedo.min()) > 0.3


def test_parameters_go_to_units_and_back() -> None:
    surface = OpenPBRSurface()
    values = planted(surface, 5, tuple(surface.layers))
    parameters = parameters_of(surface, tuple(surface.layers))
    again = split(joined(values, parameters), parameters)
    for name, value in values.items():
        torch.testing.assert_close(again[name], value, rtol=1e-4, atol=1e-5)


def bright(gain: float) -> SPMM:
    model = planted_model(size=2)
    model.weight.data *= gain
    return model


def test_a_model_that_is_too_bright_gets_a_gain() -> None:
    dark, light = look_of(bright(0.05)), look_of(bright(50.0))
    assert dark.gain == 1.0
    assert gain_note(dark.gain) == ()
    assert light.gain > 10.0
    assert f"{light.gain:.3g} times darker" in gain_note(light.gain)[0]
    torch.testing.assert_close(light.value * light.gain, dark.value * 1000.0, rtol=1e-3, atol=1e-3)


def test_texels_centres_show_their_own_surface() -> None:
    surface = GLTFSurface()
    values = planted(surface, 6, ("sheen",))
    material = Textured(surface, values, 2, 3, gain=2.0)
    _, wi, wo = random_queries(50)
    value = material(torch.tensor([5 / 6, 0.25]), wi, wo)
    own = {name: part[5:] for name, part in values.items()}
    expected = 2.0 * surface.eval(own, wi.T, wo.T)[0]
    torch.testing.assert_close(value, expected, rtol=1e-4, atol=1e-5)


def test_display_values_are_finite_at_black() -> None:
    value = torch.zeros(1, requires_grad=True)
    shown(value, 1.0).sum().backward()
    assert value.grad is not None
    assert bool(value.grad.isfinite().all())
