"""Reflections against the project's own GGX, integrals, and the shaders of MaterialX."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.brdf.ggx import GGX
from spmm_torch.export.loss import random_queries
from spmm_torch.export.surface import microfacet
from spmm_torch.export.surface.angles import Angles, shading_frames
from spmm_torch.export.surface.gltf import GLTFSurface, axis
from spmm_torch.export.surface.microfacet import (
    GGX_ALBEDO,
    SHEEN_ALBEDO,
    Roughness,
    charlie,
    charlie_albedo,
    dielectric_fresnel,
    ggx_albedo,
    ggx_distribution,
    schlick,
    smith,
    zeltner,
    zeltner_albedo,
)
from spmm_torch.geometry.warp import square_to_uniform_hemisphere

ALPHAS = torch.tensor([[0.3], [0.6], [0.9]])


def flat_angles(wi: Tensor, wo: Tensor) -> Angles:
    """The angles of pairs `[S, 3]` on texels whose normal is z."""
    return Angles.build(torch.zeros(len(ALPHAS), 2), wi.T, wo.T)


def test_ggx_is_that_of_the_fit() -> None:
    _, wi, wo = random_queries(200)
    angles = flat_angles(wi, wo)
    angle = torch.tensor([0.0, 0.7, 2.0])[:, None]
    alpha = Roughness(ALPHAS, 0.5 * ALPHAS, torch.cos(2 * angle), torch.sin(2 * angle))
    f0 = 0.3
    fresnel = f0 + (1.0 - f0) * schlick(angles.cos_d)
    ours = ggx_distribution(angles, alpha) * smith(angles, alpha) * fresnel
    for row in range(len(ALPHAS)):
        c, s = torch.cos(angle[row]), torch.sin(angle[row])
        turned = [
            torch.stack((c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0], w[:, 2]), -1)
            for w in (wi, wo)
        ]
        kappa = torch.tensor([float(ALPHAS[row]), 0.5 * float(ALPHAS[row]), f0])
        steep = (wi[:, 2] > 0.02) & (wo[:, 2] > 0.02)
        theirs = GGX().eval(kappa.expand(200, 3), *turned)
        torch.testing.assert_close(ours[row][steep], theirs[steep], rtol=1e-3, atol=1e-5)


def test_a_dielectric_reflects_as_fresnel_says() -> None:
    theta = np.linspace(0.0, 1.55, 20)
    ior = (1 + np.sqrt(0.1)) / (1 - np.sqrt(0.1))
    inside = np.sqrt(1 - (np.sin(theta) / ior) ** 2)
    s = (np.cos(theta) - ior * inside) / (np.cos(theta) + ior * inside)
    p = (inside - ior * np.cos(theta)) / (inside + ior * np.cos(theta))
    found = dielectric_fresnel(torch.from_numpy(np.cos(theta)), torch.tensor(0.1).double())
    np.testing.assert_allclose(found.numpy(), 0.5 * (s**2 + p**2), rtol=1e-6)


@pytest.mark.parametrize("height", [0.3, 0.6, 0.95])
def test_albedos_are_those_of_the_lobes(height: float) -> None:
    """By an integral over lights; the fits are rational, and off by some hundredths."""
    points = torch.quasirandom.SobolEngine(2).draw(1 << 15)
    wi = square_to_uniform_hemisphere(points)
    wo = torch.tensor([(1.0 - height**2) ** 0.5, 0.0, height]).expand_as(wi)
    angles, view = flat_angles(wi, wo), torch.full_like(ALPHAS, height)

    def integral(values: Tensor) -> Tensor:
        return 2.0 * torch.pi * values.mean(1, keepdim=True)

    alpha = Roughness(ALPHAS, ALPHAS)
    f = 0.2 + 0.8 * schlick(angles.cos_d)
    reflected = ggx_distribution(angles, alpha) * smith(angles, alpha) * f * angles.i.z
    torch.testing.assert_close(
        integral(reflected), ggx_albedo(view, ALPHAS, 0.2), atol=0.04, rtol=0
    )
    sheen = charlie(angles, ALPHAS) * angles.i.z
    torch.testing.assert_close(integral(sheen), charlie_albedo(view, ALPHAS), atol=0.06, rtol=0)
    fuzz = integral(zeltner(angles, ALPHAS))
    torch.testing.assert_close(fuzz, zeltner_albedo(view, ALPHAS), atol=0.03, rtol=0)


def test_numbers_are_those_of_materialx() -> None:
    package = pytest.importorskip("MaterialX", reason="needs materialx")
    folder = Path(package.__file__).parent / "libraries" / "pbrlib" / "genglsl" / "lib"
    own = Path(microfacet.__file__).read_text(encoding="utf-8")
    for file, function in (
        ("mx_microfacet_specular.glsl", "mx_ggx_dir_albedo_analytic"),
        ("mx_microfacet_sheen.glsl", "mx_imageworks_sheen_dir_albedo_analytic"),
        ("mx_microfacet_sheen.glsl", "mx_zeltner_sheen_dir_albedo"),
        ("mx_microfacet_sheen.glsl", "mx_zeltner_sheen_ltc_aInv"),
        ("mx_microfacet_sheen.glsl", "mx_zeltner_sheen_ltc_bInv"),
    ):
        text = (folder / file).read_text(encoding="utf-8")
        body = text.split(f" {function}(")[1].split("\n}")[0]
        numbers = set(re.findall(r"\d+\.\d{2,}", body))
        assert numbers
        assert {float(each) for each in numbers} <= {
            float(each) for each in re.findall(r"\d+\.\d{2,}", own)
        }
    assert (len(GGX_ALBEDO), len(SHEEN_ALBEDO)) == (9, 6)


def test_frames_are_those_of_a_renderer() -> None:
    slope = torch.tensor([[0.0, 0.0], [0.5, 0.0], [0.3, -0.4]])
    frames = shading_frames(slope)
    unit = torch.eye(3).expand(3, 3, 3)
    torch.testing.assert_close(frames @ frames.transpose(1, 2), unit, atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(frames), torch.ones(3))
    torch.testing.assert_close(frames[:, 2, :2], slope)
    assert bool((frames[:, 0, 0] > 0.8).all())


def test_an_axis_has_two_forms() -> None:
    angle, strength = torch.tensor([[0.4], [2.5]]), torch.tensor([[0.5], [0.9]])
    double = strength * torch.cat((torch.cos(2 * angle), torch.sin(2 * angle)), dim=1)
    plain = torch.cat((torch.cos(angle), torch.sin(angle), strength), dim=1)
    for one, other in zip(axis(double), axis(plain), strict=True):
        torch.testing.assert_close(one, other)


def test_gltf_stretches_highlights_along_the_plane() -> None:
    """As three.js and Khronos' renderer do: T and B are of the plane, N of the normal map."""
    _, wi, wo = (part.double().numpy() for part in random_queries(300))
    n = np.array([0.3, -0.2, np.sqrt(1.0 - 0.13)])
    t, b = np.array([0.8, 0.6, 0.0]), np.array([-0.6, 0.8, 0.0])
    rough, strength = 0.5, 0.6
    alpha = rough**2
    along = alpha + (1.0 - alpha) * strength**2
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    lit = (wi @ n > 0.01) & (wo @ n > 0.01) & (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    product = along * alpha
    stretched = np.stack((alpha * (h @ t), along * (h @ b), product * (h @ n)), axis=1)
    distribution = product / np.pi * (product / (stretched**2).sum(1)) ** 2
    lengths = [
        np.linalg.norm(np.stack((along * (w @ t), alpha * (w @ b), w @ n), axis=1), axis=1)
        for w in (wi, wo)
    ]
    visible = 0.5 / ((wo @ n) * lengths[0] + (wi @ n) * lengths[1])
    expected = distribution * visible * (wi @ n)
    values = {
        "base_color": torch.ones(1, 3),
        "metallic": torch.ones(1, 1),
        "roughness": torch.full((1, 1), rough),
        "normal": torch.tensor(n[None, :2]).float(),
        "anisotropy": torch.tensor([[0.8, 0.6, strength]]),
    }
    found = GLTFSurface().eval(values, *(torch.tensor(w.T).float() for w in (wi, wo)))[0, :, 0]
    np.testing.assert_allclose(found.numpy()[lit], expected[lit], rtol=2e-3, atol=1e-5)
