"""Truncated singular value decomposition of a BTF that memory cannot hold, in a few passes."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from ..btf import BTF, CHUNK_VALUES
from ..store import Progress
from .colour import encode

# Dimensions of the random subspace beyond those that are kept, and power iterations towards the
# leading singular vectors: with these the error is within 1 % of the smallest possible one.
OVERSAMPLING = 20
POWER_ITERATIONS = 2
# Passes over the BTF: the power iterations, one for the range and one for the coordinates.
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
    """The leading singular triplets of the matrix `[T, D]` of each channel, or of `[T, D C]`.

    Randomized subspace iteration [Halko, Martinsson, Tropp 2011, Alg. 4.4] with M^T M, so that
    memory holds only U and SV.

    Args:
        btf: BTF to factor.
        components: number of triplets; fewer if the matrix has fewer rows or columns.
        joint: whether to factor one matrix of all channels, channel fastest, instead of one each.
        colour_model, log_values: encoding of the values, see `colour.encode`.
        generator: random generator on the CPU; one seed gives one result on a device.
        dtype: type to compute in.
        device: device to compute on.
        progress: called with (texels done, texels of all passes).

    Returns:
        one factorization, or one for each channel: singular values `[k]`, U `[D, k]` or
        `[D C, k]`, and SV `[T, k]`, on the CPU.

    Raises:
        DataError: a picture cannot be decoded, or a value is not valid.
    """
    matrices = 1 if joint else btf.channels
    width = btf.pair_count * (btf.channels if joint else 1)
    rank = min(components + OVERSAMPLING, btf.texel_count, width)
    size = max(CHUNK_VALUES // (btf.pair_count * btf.channels), 1)
    done = 0

    def blocks() -> Iterator[Tensor]:
        """The rows `[matrices, n, width]` of each block of texels."""
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
    """The leading singular triplets of M = coordinates basis^T.

    Args:
        basis: orthonormal columns `[width, rank]`.
        coordinates: coordinates of the rows of M, `[T, rank]`.
        components: number of triplets, k.
    """
    gram = coordinates.T.double() @ coordinates.double()  # [rank, rank]
    squares, vectors = torch.linalg.eigh(gram)  # ascending
    turn = vectors[:, -components:].flip(1).to(basis.dtype)
    singular_values = squares[-components:].flip(0).clamp_min(0.0).sqrt()
    return singular_values, basis @ turn, coordinates @ turn
