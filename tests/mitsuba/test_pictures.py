"""Pictures of Mitsuba: those of our renderer, their gradients, and one ray at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.geometry.directions import MIRROR, REPEAT, ring_directions
from spmm_torch.mitsuba.material import Material
from spmm_torch.render import (
    Camera,
    DirectionalLight,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from tests.mitsuba.queries import random_queries, vectors
from tests.mitsuba.scenes import as_on_our_sphere, sphere_scene, sun
from tests.planted.models import (
    FEW_RINGS,
    planted_model,
    planted_relief,
    uneven_model,
    with_components,
    with_relief,
)
from tests.planted.runs import model_folder

SUN = (0.4, 0.5, 1.0)


def textured(mi: Any, run: Path) -> dict[str, Any]:
    """The plug-in with one copy of its texture along half a turn, as `Texture` has it."""
    return {"type": "spmm", "filename": str(run), "to_uv": as_on_our_sphere(mi)}


@pytest.mark.parametrize(
    ("size", "samples", "texels", "rule"),
    [
        (24, 1024, 8, REPEAT),
        (24, 1024, 8, MIRROR),
        pytest.param(64, 1024, 32, REPEAT, marks=pytest.mark.slow),
    ],
)
def test_the_picture_is_that_of_our_renderer(
    size: int, samples: int, texels: int, rule: str, mi: Any, tmp_path: Path
) -> None:
    hold(mi, size, samples, texels, rule, tmp_path)


@pytest.mark.gpu(simulated=False)
def test_the_picture_of_a_gpu_is_that_of_our_renderer(cuda: Any, tmp_path: Path) -> None:
    hold(cuda, 64, 1024, 32, REPEAT, tmp_path)


def hold(mi: Any, size: int, samples: int, texels: int, rule: str, tmp_path: Path) -> None:
    """Holds a picture of Mitsuba to ours, of a relief that continues by a rule."""
    model = with_components(planted_model(size=texels, residual=0.02), beside=True)
    model = with_relief(model, planted_relief(texels, texels, rule=rule))
    run = model_folder(tmp_path / "run", model)
    scene = sphere_scene(mi, textured(mi, run), {"sun": sun(SUN)}, size)
    found = np.array(mi.render(scene, spp=samples, seed=0))
    ours = Scene(Sphere(Texture()), Camera.orthographic(), (DirectionalLight.build(SUN),))
    expected = render(model, ours, RenderSettings(size=size, samples=samples)).picture.numpy()
    error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
    assert error < 0.01  # noise within pixels is most of it


def small_model() -> SPMM:
    directions = ring_directions(FEW_RINGS)
    return with_components(uneven_model([2, 3, 1, 2], 2, directions, directions), beside=True)


def test_gradients_flow_to_every_parameter(mi: Any, tmp_path: Path) -> None:
    import drjit

    run = model_folder(tmp_path / "run", small_model())
    scene = sphere_scene(mi, textured(mi, run), {"sun": sun(SUN)}, 8)
    parameters = mi.traverse(scene)
    integrator = mi.load_dict({"type": "prb", "max_depth": 2})
    weight = parameters["ball.bsdf.weight"]
    drjit.enable_grad(weight)
    parameters.update()
    picture = mi.render(scene, parameters, integrator=integrator, spp=16, seed=0, seed_grad=1)
    drjit.backward(drjit.sum(picture, axis=None))
    gradient = np.array(drjit.grad(weight))
    drjit.disable_grad(weight)
    change = np.zeros_like(gradient)
    change[1, 0] = 0.5  # the picture is linear in the weights
    totals = []
    weights = np.array(weight)
    for given in (weights + change, weights):
        parameters["ball.bsdf.weight"] = mi.TensorXf(given)
        parameters.update()
        picture = mi.render(scene, integrator=integrator, spp=16, seed=1)
        totals.append(np.array(picture).sum(dtype=np.float64))
    assert gradient[1, 0] == pytest.approx((totals[0] - totals[1]) / 0.5, rel=1e-3)
    assert gradient[1, 0] > 0.0


@pytest.mark.parametrize(
    "name",
    [
        "kappa",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("weight", "normal", "residual", "coefficients")
        ),
    ],
)
def test_gradients_are_those_of_torch(name: str, mi: Any) -> None:
    import drjit

    model = small_model()
    material = Material(small_model())
    uv, wi, wo = random_queries(500)
    parameter = material.parameters[name]
    drjit.enable_grad(parameter)
    material.update()
    up = mi.Point2f(*uv.T.contiguous().numpy())
    light, view = vectors(mi, wi), vectors(mi, wo)
    found, _ = material.evaluated(material.seen(up, view), light)
    drjit.backward(drjit.sum(drjit.sum(found)))
    owner = {"residual": model.residual, "coefficients": model.components}.get(name)
    if owner is None:
        leaf = getattr(model, name)
        model(uv, wi, wo).sum().backward()
        expected = leaf.grad
    else:
        expected = by_torch(model, name, uv, wi, wo)
    gradient = torch.from_numpy(np.array(drjit.grad(parameter)))
    torch.testing.assert_close(gradient, expected, rtol=2e-3, atol=2e-4)


def by_torch(model: SPMM, name: str, uv: Any, wi: Any, wo: Any) -> Any:
    """Gradients of a residual, whose codes are numbers themselves."""
    assert model.components is not None
    if name == "residual":
        scale = model.residual.scale.view(-1, 1, 1, 1)
        leaf = (model.residual.code.float() * scale).detach().requires_grad_()
        model.residual = model.residual.with_codes(leaf.detach(), torch.ones(len(leaf)))
        code = model.residual.code
    else:
        values = model.components.coefficients()
        model.components = model.components.with_codes(
            coefficient=values, coefficient_scale=torch.ones(values.shape[1])
        )
        code = model.components.coefficient
    code.requires_grad_()
    model(uv, wi, wo).sum().backward()
    return code.grad


def test_one_ray_at_a_time(scalar: Any, tmp_path: Path) -> None:
    model = small_model()
    run = model_folder(tmp_path / "run", model)
    bsdf = scalar.load_dict(textured(scalar, run))
    uv, wi, wo = random_queries(6)
    si = scalar.SurfaceInteraction3f()
    for at, light, view in zip(uv, wi, wo, strict=True):
        si.uv, si.wi = [float((at[0] - 0.5) / 2.0), float(1.0 - at[1])], view.tolist()
        value, density = bsdf.eval_pdf(scalar.BSDFContext(), si, scalar.Vector3f(light.tolist()))
        with torch.no_grad():
            expected, pdf = model(at, light, view), model.pdf(at, light, view)
        torch.testing.assert_close(torch.tensor(list(value)), expected, rtol=1e-4, atol=1e-5)
        assert float(density) == pytest.approx(float(pdf), rel=1e-4)
    picture = np.array(
        scalar.render(sphere_scene(scalar, textured(scalar, run), {"sun": sun(SUN)}, 4), spp=2)
    )
    assert np.isfinite(picture).all() and picture.mean() > 0.0
