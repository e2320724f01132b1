"""MERL tables against the published look-up, written a second time, and known functions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spmm_torch.data.brdf_tables import merl
from spmm_torch.errors import DataError
from tests.data.brdf_tables.made_files import grey, merl_bytes, upper_directions


def published(values: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> list[float]:
    """`lookup_brdf_val` of the database's own reader, for one pair; values are flat."""

    def turned(vector: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
        along = axis * (axis @ vector) * (1.0 - math.cos(angle))
        return vector * math.cos(angle) + along + np.cross(axis, vector) * math.sin(angle)

    half = (wi + wo) / np.linalg.norm(wi + wo)
    theta_half, phi_half = math.acos(half[2]), math.atan2(half[1], half[0])
    first = turned(wi, np.array([0.0, 0.0, 1.0]), -phi_half)
    diff = turned(first, np.array([0.0, 1.0, 0.0]), -theta_half)
    theta_diff, phi_diff = math.acos(min(diff[2], 1.0)), math.atan2(diff[1], diff[0])
    half_degrees = theta_half / (math.pi / 2.0) * 90
    half_index = min(int(math.sqrt(half_degrees * 90)), 89)
    diff_index = min(int(theta_diff / (math.pi * 0.5) * 90), 89)
    phi_diff += math.pi if phi_diff < 0.0 else 0.0
    phi_index = min(int(phi_diff / math.pi * 360 / 2), 179)
    place = phi_index + diff_index * 180 + half_index * 180 * 90
    scales = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)
    return [values[place + c * 90 * 90 * 180] * scale for c, scale in enumerate(scales)]


def test_values_are_those_of_the_published_reader() -> None:
    values = np.random.default_rng(0).random(3 * math.prod(merl.CELLS))
    table = merl.read_table(merl.HEADER + values.tobytes(), "made")
    wi, wo = upper_directions(400, 1), upper_directions(400, 2)
    expected = [published(values, *pair) for pair in zip(wi, wo, strict=True)]
    np.testing.assert_allclose(merl.evaluate(table, wi, wo), expected, rtol=1e-12)


def test_a_function_of_the_half_angle_is_found() -> None:
    def lobe(theta_half: np.ndarray, *_: np.ndarray) -> np.ndarray:
        return np.cos(theta_half)[..., None] ** 20 * np.array([0.2, 1.0, 3.0])

    table = merl.read_table(merl_bytes(lobe), "made")
    wi, wo = upper_directions(200, 3), upper_directions(200, 4)
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    expected = half[:, 2:] ** 20 * np.array([0.2, 1.0, 3.0])
    np.testing.assert_allclose(merl.evaluate(table, wi, wo), expected, atol=0.05 * 3.0)


def test_the_difference_direction_keeps_its_azimuth() -> None:
    """Where the half vector is z, angles of the difference are those of the light."""
    theta, phi = math.radians(40.0), math.radians(70.0)
    wi = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), 0.0])
    wi[2] = math.cos(theta)
    angles = merl.half_difference_angles(wi[None], (wi * [-1.0, -1.0, 1.0])[None])
    np.testing.assert_allclose(np.ravel(angles), [0.0, theta, phi], atol=1e-12)


def test_an_angle_on_an_edge_is_of_the_upper_cell_in_float32_too() -> None:
    theta = math.radians(15.0)
    for nudge in (-3e-7, 0.0, 3e-7):
        wi = np.array([[math.sin(theta + nudge), 0.0, math.cos(theta + nudge)]])
        assert merl.cells(wi, wi * [-1.0, 1.0, 1.0])[1] == 15


def test_negative_values_were_not_measured() -> None:
    table = merl.read_table(merl_bytes(grey(-1.0)), "made")
    up = np.array([[0.0, 0.0, 1.0]])
    assert np.isnan(merl.evaluate(table, up, up)).all()


@pytest.mark.parametrize(
    ("payload", "found"),
    [
        (merl.HEADER + bytes(80), "has 92 bytes and starts with 90, 90, 180"),
        (b"\x01\0\0", "has 3 bytes and starts with no whole header"),
        (np.array([90, 90, 360], "<i4").tobytes() + bytes(80), "starts with 90, 90, 360"),
    ],
)
def test_a_wrong_size_is_one_sentence(payload: bytes, found: str) -> None:
    with pytest.raises(DataError, match="expected 34,992,012 bytes") as caught:
        merl.read_table(payload, "gold.binary")
    assert found in str(caught.value)
    assert str(caught.value).startswith("gold.binary")
