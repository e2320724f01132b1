"""Made MERL and RGL files: small functions that are known, never measured data."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from spmm_torch.data.brdf_tables import merl, tensor_file

TYPE_CODES = {np.dtype(name): code for code, name in enumerate(tensor_file.TYPES, start=1)}
# (theta_half, theta_difference, phi_difference) to values [..., 3] in 1/sr
Function = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def merl_bytes(function: Function) -> bytes:
    """A MERL file that holds a function at the middle of each cell."""
    middle = np.arange(90) + 0.5
    theta_half = np.radians(middle**2 / 90.0)
    phi = np.radians(np.arange(180) + 0.5)
    angles = np.meshgrid(theta_half, np.radians(middle), phi, indexing="ij")
    values = np.moveaxis(function(*angles) / merl.SCALE, -1, 0)
    return merl.HEADER + np.ascontiguousarray(values, "<f8").tobytes()


def grey(value: float) -> Function:
    """The BRDF that has one value everywhere."""
    return lambda theta_half, *_: np.full((*theta_half.shape, 3), value)


def tensor_bytes(tensors: dict[str, np.ndarray]) -> bytes:
    """A tensor file, each array behind the last, as Mitsuba's own writer has them."""
    heads = [
        struct.pack("<H", len(name)) + name.encode() + struct.pack("<HB", array.ndim, code(array))
        for name, array in tensors.items()
    ]
    start = len(tensor_file.MAGIC) + 6
    start += sum(
        len(head) + 8 + 8 * array.ndim for head, array in zip(heads, tensors.values(), strict=True)
    )
    parts = [tensor_file.MAGIC, struct.pack("<BBI", 1, 0, len(tensors))]
    for head, array in zip(heads, tensors.values(), strict=True):
        parts += [head, struct.pack(f"<{1 + array.ndim}Q", start, *array.shape)]
        start += array.nbytes
    return b"".join([*parts, *(array.tobytes() for array in tensors.values())])


def code(array: np.ndarray) -> int:
    """The number of an array's type in a tensor file."""
    return TYPE_CODES[array.dtype]


def rgl_tensors(phi: np.ndarray, seed: int = 0, jacobian: int = 1) -> dict[str, np.ndarray]:
    """Tables of a BRDF of random values at azimuths `phi`; isotropic if there are one or two.

    Those of an isotropic BRDF are the same at each azimuth, and for mirrored ones.
    """
    generator = np.random.default_rng(seed)
    isotropic = len(phi) <= 2

    def table(*shape: int) -> np.ndarray:
        values = generator.uniform(0.2, 1.0, shape)
        if isotropic:
            values = values + values[..., ::-1, :]
        return values.astype("<f4")

    def tables(*shape: int) -> np.ndarray:
        """One table for each azimuth and polar angle."""
        repeats = len(phi) if isotropic else 1
        return np.repeat(table(len(phi) // repeats, len(theta), *shape), repeats, axis=0)

    theta = np.linspace(0.0, np.pi / 2.0, 4, dtype="<f4")
    sigma = table(6, 8)
    return {
        "description": np.frombuffer(b"made", "<u1"),
        "phi_i": phi.astype("<f4"),
        "theta_i": theta,
        "ndf": table(5, 7),
        "sigma": np.repeat(sigma[:1], 6, axis=0) if isotropic else sigma,
        "vndf": tables(6, 5),
        "luminance": tables(8, 8),
        "rgb": tables(3, 8, 8),
        "jacobian": np.array([jacobian], "<u1"),
    }


def write(path: Path, payload: bytes) -> Path:
    """Writes a file and its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(payload)
    return path


def upper_directions(count: int, seed: int) -> np.ndarray:
    """Random unit directions `[N, 3]` over the horizon."""
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) + 0.02
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
