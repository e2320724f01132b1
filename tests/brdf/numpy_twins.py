"""The BRDFs once more, in NumPy and in angles, as the literature writes them.

Oracles for tests: plain, slow, valid only above the horizon, and sharing no algebra with the
package. Every function takes parameters `kappa [P]` and directions `[N, 3]`, and returns `[N]`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Angles:
    """Spherical angles (radians) of light, view and half vector, and the difference angle."""

    theta_i: Array
    phi_i: Array
    theta_o: Array
    phi_o: Array
    theta_h: Array
    phi_h: Array
    theta_d: Array


def angles(wi: Array, wo: Array) -> Angles:
    """The angles of directions `[N, 3]`."""

    def spherical(w: Array) -> tuple[Array, Array]:
        return np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]), np.arctan2(w[:, 1], w[:, 0])

    h = wi + wo
    h = h / np.linalg.norm(h, axis=1, keepdims=True)
    theta_d = np.arctan2(np.linalg.norm(np.cross(h, wi), axis=1), np.sum(h * wi, axis=1))
    return Angles(*spherical(wi), *spherical(wo), *spherical(h), theta_d)


def schlick(f0: float, theta: Array) -> Array:
    """Schlick's Fresnel term [Sch94, Eq. 15]."""
    return f0 + (1 - f0) * (1 - np.cos(theta)) ** 5


def lambertian(kappa: Array, wi: Array, wo: Array) -> Array:
    """1 / pi."""
    return np.full(len(wi), 1 / np.pi)


def oren_nayar(kappa: Array, wi: Array, wo: Array) -> Array:
    """The qualitative model [ON94], albedo 1."""
    (sigma,) = kappa
    a = angles(wi, wo)
    alpha, beta = np.maximum(a.theta_i, a.theta_o), np.minimum(a.theta_i, a.theta_o)
    big_a = 1 - 0.5 * sigma**2 / (sigma**2 + 0.33)
    big_b = 0.45 * sigma**2 / (sigma**2 + 0.09)
    swing = np.maximum(0, np.cos(a.phi_o - a.phi_i)) * np.sin(alpha) * np.tan(beta)
    return (big_a + big_b * swing) / np.pi


def blinn_phong(kappa: Array, wi: Array, wo: Array) -> Array:
    """cos^n(theta_h) [Bli77] over its cosine-weighted integral at normal incidence."""
    (n,) = kappa
    # With theta_h = theta / 2 = x: 2 pi * integral of cos^n(x) cos(2x) sin(2x) 2 dx to pi / 4.
    # sin 2x = 2 sin x cos x and cos 2x = 2 cos^2 x - 1, so with c = cos x the antiderivative is
    low = np.cos(np.pi / 4)
    integral = 16 * np.pi * (1 - low ** (n + 4)) / (n + 4)
    integral -= 8 * np.pi * (1 - low ** (n + 2)) / (n + 2)
    return np.cos(angles(wi, wo).theta_h) ** n / integral


def ward(kappa: Array, wi: Array, wo: Array) -> Array:
    """[War92, Eq. 5a]."""
    alpha_x, alpha_y = kappa
    a = angles(wi, wo)
    spread = np.cos(a.phi_h) ** 2 / alpha_x**2 + np.sin(a.phi_h) ** 2 / alpha_y**2
    gaussian = np.exp(-(np.tan(a.theta_h) ** 2) * spread) / (4 * np.pi * alpha_x * alpha_y)
    return gaussian / np.sqrt(np.cos(a.theta_i) * np.cos(a.theta_o))


def ward_duer(kappa: Array, wi: Array, wo: Array) -> Array:
    """Ward's model in the normalization of Duer (2006)."""
    a = angles(wi, wo)
    return ward(kappa, wi, wo) / np.sqrt(np.cos(a.theta_i) * np.cos(a.theta_o))


def cook_torrance(kappa: Array, wi: Array, wo: Array) -> Array:
    """F D G / (4 cos_i cos_o) with normalized Beckmann and the V-groove term [CT82]."""
    m, f0 = kappa
    a = angles(wi, wo)
    beckmann = np.exp(-(np.tan(a.theta_h) ** 2) / m**2) / (np.pi * m**2 * np.cos(a.theta_h) ** 4)
    lower = np.minimum(np.cos(a.theta_i), np.cos(a.theta_o))
    groove = np.minimum(1, 2 * np.cos(a.theta_h) * lower / np.cos(a.theta_d))
    fresnel = schlick(f0, a.theta_d)
    return fresnel * beckmann * groove / (4 * np.cos(a.theta_i) * np.cos(a.theta_o))


def lafortune(kappa: Array, wi: Array, wo: Array) -> Array:
    """One generalized cosine lobe [LFTG97] of Cx = Cy = C and Cz = 1, scaled to a base of 1."""
    c, n = kappa
    a = angles(wi, wo)
    across = c * np.sin(a.theta_i) * np.sin(a.theta_o) * np.cos(a.phi_i - a.phi_o)
    base = across + np.cos(a.theta_i) * np.cos(a.theta_o)
    return (n + 2) / (2 * np.pi) * (np.maximum(base, 0) / max(1, abs(c))) ** n


def ashikhmin_shirley(kappa: Array, wi: Array, wo: Array) -> Array:
    """The specular term of [AS00]."""
    nu, nv, f0 = kappa
    a = angles(wi, wo)
    power = nu * np.cos(a.phi_h) ** 2 + nv * np.sin(a.phi_h) ** 2
    lobe = np.sqrt((nu + 1) * (nv + 1)) / (8 * np.pi) * np.cos(a.theta_h) ** power
    upper = np.maximum(np.cos(a.theta_i), np.cos(a.theta_o))
    return lobe * schlick(f0, a.theta_d) / (np.cos(a.theta_d) * upper)


def ggx(kappa: Array, wi: Array, wo: Array) -> Array:
    """F D G / (4 cos_i cos_o) with Smith's G of correlated heights [WMLT07, Hei14]."""
    alpha_x, alpha_y, f0 = kappa
    a = angles(wi, wo)

    def smith_lambda(theta: Array, phi: Array) -> Array:
        roughness = np.hypot(alpha_x * np.cos(phi), alpha_y * np.sin(phi))
        return (np.sqrt(1 + (roughness * np.tan(theta)) ** 2) - 1) / 2

    slope = np.tan(a.theta_h) ** 2
    slope = slope * (np.cos(a.phi_h) ** 2 / alpha_x**2 + np.sin(a.phi_h) ** 2 / alpha_y**2)
    trowbridge_reitz = 1 / (np.pi * alpha_x * alpha_y * np.cos(a.theta_h) ** 4 * (1 + slope) ** 2)
    smith = 1 / (1 + smith_lambda(a.theta_i, a.phi_i) + smith_lambda(a.theta_o, a.phi_o))
    reflected = schlick(f0, a.theta_d) * trowbridge_reitz * smith
    return reflected / (4 * np.cos(a.theta_i) * np.cos(a.theta_o))


TWINS: dict[str, Callable[[Array, Array, Array], Array]] = {
    twin.__name__: twin
    for twin in (
        lambertian,
        oren_nayar,
        blinn_phong,
        ward,
        cook_torrance,
        lafortune,
        ashikhmin_shirley,
        ward_duer,
        ggx,
    )
}


def twin_of(name: str) -> Callable[[Array, Array, Array], Array]:
    """The twin of a model."""
    assert name in TWINS, f"{name} has no twin; add it to TWINS in tests/brdf/numpy_twins.py"
    return TWINS[name]
