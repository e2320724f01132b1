"""MERL tables against the published look-up, written a second time, and known functions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spmm_torch.data.brdf_tables import merl
from spmm_torch.errors import DataError
from tests.data.brdf_tables.made_files import merl_bytes, upper_directions


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


def middles(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions wi and wo `[N, 3]` at the middles of random cells, both over the horizon."""
    rng = np.random.default_rng(seed)
    theta_half = np.radians((rng.integers(0, 60, count) + 0.5) ** 2 / 90.0)
    theta, phi = (
        np.radians(rng.integers(0, 45, count) + 0.5),
        np.radians(rng.integers(0, 180, count) + 0.5),
    )
    turn = rng.uniform(-np.pi, np.pi, count)
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)

    def placed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """A direction in the frame of the half vector, in that of the surface."""
        along = np.cos(theta_half) * x + np.sin(theta_half) * z
        up = np.cos(theta_half) * z - np.sin(theta_half) * x
        across = np.sin(turn) * along + np.cos(turn) * y
        return np.stack((np.cos(turn) * along - np.sin(turn) * y, across, up), axis=1)

    wi, wo = placed(x, y), placed(-x, -y)
    over = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    return wi[over], wo[over]


def test_values_in_the_middle_of_cells_are_those_of_the_published_reader() -> None:
    values = np.random.default_rng(0).random(3 * math.prod(merl.CELLS))
    table = merl.read_table(merl.HEADER + values.tobytes(), "made")
    wi, wo = middles(400, 1)
    assert len(wi) > 300
    expected = [published(values, *pair) for pair in zip(wi, wo, strict=True)]
    np.testing.assert_allclose(merl.evaluate(table, wi, wo), expected, rtol=1e-6)


def test_a_function_of_all_angles_is_found() -> None:
    """Between the middles of cells too, across the end of phi_difference too."""

    def lobe(theta_half: np.ndarray, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        value = np.cos(theta_half) ** 20 * (1.0 + 0.5 * np.sin(theta) ** 2 * np.cos(2.0 * phi))
        return value[..., None] * np.array([0.2, 1.0, 3.0])

    table = merl.read_table(merl_bytes(lobe), "made")
    wi, wo = upper_directions(2000, 3), upper_directions(2000, 4)
    expected = lobe(*merl.half_difference_angles(wi, wo))
    np.testing.assert_allclose(merl.evaluate(table, wi, wo), expected, atol=0.003 * 3.0)


def test_the_difference_direction_keeps_its_azimuth() -> None:
    """Where the half vector is z, angles of the difference are those of the light."""
    theta, phi = math.radians(40.0), math.radians(70.0)
    wi = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), 0.0])
    wi[2] = math.cos(theta)
    angles = merl.half_difference_angles(wi[None], (wi * [-1.0, -1.0, 1.0])[None])
    np.testing.assert_allclose(np.ravel(angles), [0.0, theta, phi], atol=1e-12)


def test_cells_that_were_not_measured_are_left_out() -> None:
    """Where the difference is over 41 degrees nothing was measured; under that all is 1."""

    def part(theta_half: np.ndarray, theta: np.ndarray, _phi: np.ndarray) -> np.ndarray:
        value = np.where(theta < math.radians(41.0), 1.0, -1.0) + 0.0 * theta_half
        return np.repeat(value[..., None], 3, axis=-1)

    table = merl.read_table(merl_bytes(part), "made")
    theta = np.radians([10.0, 40.4, 40.9, 41.1, 60.0])
    wi = np.stack((np.sin(theta), 0.0 * theta, np.cos(theta)), axis=1)
    found = merl.evaluate(table, wi, wi * [-1.0, 1.0, 1.0])[:, 0]
    np.testing.assert_allclose(found, [1.0, 1.0, 1.0, np.nan, np.nan])


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
