"""Truncated singular value decomposition of a BTF too large to hold, in a few passes over it."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from ..btf import BTF, CHUNK_VALUES
from ..store import Progress
from .colour import encode

# The random subspace is larger than what is kept by this much, and pulled towards the leading
# singular vectors this often: the error is within a percent of the best possible one.
OVERSAMPLING = 20
POWER_ITERATIONS = 2
# One more for the range itself and one for the coordinates.
PASSES = POWER_ITERATIONS + 2

Factorization = tuple[Tensor, Tensor, Tensor]  # singular values [k], U [rows, k], SV [T, k]


def factorize(
    btf: BTF,
    components: int,
    *,
    joint: bool,
    colour_model: int,
    log_values: bool,
    generator: torch.Generator,
    dtype: torch.dtype,
    device: torch.device,
    progress: Progress | None = None,
) -> list[Factorization]:
    """The leading singular triplets of a BTF's matrix `[T, D]` of each channel, or `[T, D C]`.

    Randomized subspace iteration [Halko, Martinsson, Tropp 2011, Alg. 4.4] with M^T M, so that
    only U and SV are held.

    Args:
        components: how many, fewer if the matrix has fewer rows or columns.
        joint: one matrix of all channels, channel fastest, instead of one for each.
        colour_model, log_values: what to factor, see `colour.encode`.
        generator: on the CPU; the same seed gives the same factors on the same device.
        dtype: to compute in.
        progress: told (texels done, texels of all passes).

    Returns:
        one factorization, or one for each channel, on the CPU.
    """
    matrices = 1 if joint else btf.channels
    width = btf.pair_count * (btf.channels if joint else 1)
    rank = min(components + OVERSAMPLING, btf.texel_count, width)
    size = max(CHUNK_VALUES // (btf.pair_count * btf.channels), 1)
    done = 0

    def blocks() -> Iterator[Tensor]:
        """The matrices `[matrices, n, width]` of some texels at a time."""
        nonlocal done
        for start in range(0, btf.texel_count, size):
            values = btf.texels(slice(start, start + size), device).to(dtype)  # [n, D, C]
            planes = encode(values, colour_model, log_values)
            yield planes.flatten(1)[None] if joint else planes.permute(2, 0, 1).contiguous()
            done += len(values)
            if progress is not None:
                progress(done, PASSES * btf.texel_count)

    basis = torch.randn(matrices, width, rank, generator=generator, dtype=dtype).to(device)
    for _ in range(POWER_ITERATIONS + 1):
        image = torch.zeros_like(basis)
        for block in blocks():
            image += block.mT @ (block @ basis)
        basis = torch.linalg.qr(image).Q  # [matrices, width, rank]
    coordinates = torch.cat([(block @ basis).cpu() for block in blocks()], dim=1)
    kept = min(components, rank)
    return [_leading(part, rows, kept) for part, rows in zip(basis.cpu(), coordinates, strict=True)]


def _leading(basis: Tensor, coordinates: Tensor, components: int) -> Factorization:
    """Turn M = coordinates basis^T into its leading singular triplets.

    Args:
        basis: orthonormal columns `[width, rank]`.
        coordinates: `[T, rank]`.
    """
    gram = coordinates.T.double() @ coordinates.double()  # [rank, rank]
    squares, vectors = torch.linalg.eigh(gram)  # ascending
    turn = vectors[:, -components:].flip(1).to(basis.dtype)
    singular_values = squares[-components:].flip(0).clamp_min(0.0).sqrt()
    return singular_values, basis @ turn, coordinates @ turn
