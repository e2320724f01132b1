"""Write a UBO2014 `.btf` of a plausible material without measuring or rendering one.

`python tests/synthetic/btf_factors.py OUT.btf --size 400 --components 100` makes a file as large
as a real one: 400 x 400 texels, 151 views, 151 lights. The first components are analytic lobes
of tilted normals, each with its own colour and a smooth positive texture; the rest is noise that
gets finer and fainter. Only one row of pictures is in memory at a time.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from spmm_torch.data.ubo2014 import FactorRows, Header, write_factors
from spmm_torch.errors import SPMMError
from spmm_torch.geometry.directions import UBO2003_RINGS, UBO2014_RINGS

RINGS = {"ubo2003": UBO2003_RINGS, "ubo2014": UBO2014_RINGS}
VARIANT = "DFMF08FC"
# Lobes that make up the material, from a matte one to a glossy one.
EXPONENTS = (1.0, 2.0, 6.0, 12.0, 30.0, 80.0)
PEAKS = (0.35, 0.2, 0.25, 0.3, 0.5, 0.9)
TILT = 0.35  # standard deviation of the slopes of their normals
# Noise: amplitude of its first component and how fast it fades with the number of the component.
NOISE, FADING = 0.01, 0.8
# Cycles across the picture, of textures of lobes and of the finest noise.
LOBE_CYCLES, NOISE_CYCLES = 6, 40


def ring_angles(rings: Sequence[tuple[float, int]]) -> np.ndarray:
    """(polar, azimuth) `[N, 2]` in radians of rings given as (polar degrees, count)."""
    degrees = [(polar, 360.0 * step / count) for polar, count in rings for step in range(count)]
    return np.radians(np.array(degrees, dtype=np.float32))


def unit_vectors(angles: np.ndarray) -> np.ndarray:
    """Unit vectors `[N, 3]` of angles `[N, 2]`."""
    polar, azimuth = angles.T
    sine = np.sin(polar)
    return np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)), axis=-1)


def angular_factors(
    directions: np.ndarray, components: int, random: np.random.Generator
) -> list[np.ndarray]:
    """U `[D, k]` of each channel: coloured lobes, then smooth noise, cosine-weighted.

    Args:
        directions: unit vectors `[N, 3]` of the views and of the lights.
    """
    wi = np.tile(directions, (len(directions), 1))  # [D, 3], d = view * L + light
    wo = np.repeat(directions, len(directions), axis=0)
    half = wi + wo
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    factors = np.empty((3, len(wi), components))
    for j in range(components):
        if j < len(EXPONENTS):
            normal = np.append(random.normal(0.0, TILT / (j + 1), 2), 1.0)
            normal /= np.linalg.norm(normal)
            shape = np.clip(half @ normal, 0.0, None) ** EXPONENTS[j]
            colour = PEAKS[j] * random.uniform(0.3, 1.0, 3)
        else:
            phase = wi @ random.normal(0.0, 3.0, 3) + wo @ random.normal(0.0, 3.0, 3)
            shape = np.cos(phase + random.uniform(0.0, 2.0 * np.pi))
            colour = np.full(3, NOISE / (j - len(EXPONENTS) + 1) ** FADING)
        factors[:, :, j] = colour[:, None] * shape * wi[:, 2]
    return list(factors)


def textures(components: int, random: np.random.Generator) -> np.ndarray:
    """What the texture of each component is made of: `[k, 5]`.

    Columns are the cycles across the picture in u and v, a phase for each, and 1 for lobes,
    whose textures are positive, or 0 for noise.
    """
    lobes = (np.arange(components) < len(EXPONENTS)).astype(float)
    most = np.where(lobes > 0, LOBE_CYCLES, NOISE_CYCLES)[:, None]
    cycles = np.ceil(random.uniform(0.0, 1.0, (components, 2)) * most)
    phases = random.uniform(0.0, 2.0 * np.pi, (components, 2))
    return np.column_stack((cycles, phases, lobes))


def texture_rows(size: int, recipe: np.ndarray) -> Iterator[np.ndarray]:
    """SV, a row of pictures `[W, k]` at a time, from the top."""
    position = 2.0 * np.pi * np.arange(size) / size
    cycles_u, cycles_v, phase_u, phase_v, positive = recipe.T  # [k] each
    across = np.cos(position[:, None] * cycles_u + phase_u)  # [W, k]
    for row in range(size):
        wave = across * np.cos(position[row] * cycles_v + phase_v)
        yield np.where(positive > 0, 0.5 + 0.5 * wave, wave)


def write_synthetic(
    path: Path | str,
    *,
    size: int = 400,
    components: int = 100,
    scalar: int = 4,
    seed: int = 0,
    rings: str = "ubo2014",
) -> None:
    """Write the file; the same arguments give the same bytes.

    Args:
        size: texels along an edge.
        components: for each channel.
        scalar: bytes of a number: 2, 4 or 8.
        rings: of directions, "ubo2003" (81) or "ubo2014" (151).
    """
    random = np.random.default_rng(seed)
    angles = ring_angles(RINGS[rings])
    header = Header(
        variant=VARIANT,
        width=size,
        height=size,
        view=angles,
        light=angles,
        setup="synthetic",
    )
    left = angular_factors(unit_vectors(angles.astype(np.float64)), components, random)
    recipe = textures(components, random)
    factors = [
        FactorRows(np.linalg.norm(part, axis=0) * size, part, texture_rows(size, recipe))
        for part in left
    ]
    write_factors(path, header, factors, scalar=scalar)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `write_synthetic`."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("destination", help=".btf to write")
    parser.add_argument("--size", type=int, default=400, help="texels along an edge")
    parser.add_argument("--components", type=int, default=100, help="for each channel")
    parser.add_argument("--scalar", type=int, default=4, choices=(2, 4, 8), help="bytes a number")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rings", choices=tuple(RINGS), default="ubo2014", help="directions")
    given = parser.parse_args(arguments)
    try:
        write_synthetic(
            given.destination,
            size=given.size,
            components=given.components,
            scalar=given.scalar,
            seed=given.seed,
            rings=given.rings,
        )
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
