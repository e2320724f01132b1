"""Truncated singular value decomposition of a BTF that memory cannot hold, in a few passes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from ...errors import ConfigError
from ...metrics import snr_db
from ..btf import BTF, CHUNK_VALUES
from ..options import DEFAULT_COMPONENTS
from ..store import Progress
from .colour import Encoding, encode

# Dimensions of the random subspace beyond those that are kept, and power iterations towards the
# leading singular vectors: with these the error is within 1 % of the smallest possible one.
OVERSAMPLING = 20
POWER_ITERATIONS = 2
# Passes over the BTF: the power iterations, one for the range and one for the coordinates.
PASSES = POWER_ITERATIONS + 2

Factorization = tuple[Tensor, Tensor, Tensor]  # singular values [k], U [rows, k], SV [T, k]


@dataclass(frozen=True)
class Matrices:
    """The matrices of a BTF: `[T, D]` of each channel, or one `[T, D C]`, channel fastest.

    Args:
        btf: BTF to factor.
        joint: whether there is one matrix of all channels.
        encoding: of the values, see `colour.encode`.
        factor: factor `[D, 1]` of the values of each direction pair before they are encoded; None:
            1.
        dtype: type to compute in.
        device: device to compute on.
    """

    btf: BTF
    joint: bool
    encoding: Encoding
    factor: Tensor | None
    dtype: torch.dtype
    device: torch.device

    @property
    def count(self) -> int:
        """The number of matrices."""
        return 1 if self.joint else self.btf.channels

    @property
    def width(self) -> int:
        """The number of columns."""
        return self.btf.pair_count * (self.btf.channels if self.joint else 1)

    @property
    def full_rank(self) -> int:
        """The largest number of components."""
        return min(self.btf.texel_count, self.width)

    def blocks(self) -> Iterator[Tensor]:
        """The rows `[matrices, n, width]` of each block of texels."""
        btf = self.btf
        size = max(CHUNK_VALUES // (btf.pair_count * btf.channels), 1)
        for start in range(0, btf.texel_count, size):
            values = btf.texels(slice(start, start + size), self.device).to(self.dtype)
            if self.factor is not None:
                values = values * self.factor.to(values)
            planes = encode(values, self.encoding)  # [n, D, C]
            yield planes.flatten(1)[None] if self.joint else planes.permute(2, 0, 1).contiguous()


@dataclass(frozen=True)
class Truncation:
    """The leading singular triplets of each matrix, and what they leave out.

    Args:
        factors: triplets of each matrix, on the CPU.
        energy: sum of squares of all matrices.
        error: sum of squares of the differences to the product of the factors.
    """

    factors: list[Factorization]
    energy: float
    error: float

    @property
    def components(self) -> int:
        """The number of triplets of a matrix."""
        return len(self.factors[0][0])

    @property
    def snr_db(self) -> float:
        """The signal-to-noise ratio in dB."""
        return snr_db(self.energy, self.error)


def factorize(
    matrices: Matrices,
    components: int,
    generator: torch.Generator,
    progress: Progress | None = None,
) -> Truncation:
    """The leading singular triplets of each matrix.

    Args:
        matrices: of a BTF.
        components: number of triplets; fewer if a matrix has fewer rows or columns.
        generator: random generator on the CPU; one seed gives one result on a device.
        progress: called with (texels done, texels of all passes).

    Raises:
        DataError: a picture cannot be decoded, or a value is not valid.
    """
    rank = min(components + OVERSAMPLING, matrices.full_rank)
    counted = _Counted(matrices, progress)
    return _Subspace.of(counted, rank, generator).truncated(min(components, rank))


def factorize_to(
    matrices: Matrices,
    snr: float,
    generator: torch.Generator,
    progress: Progress | None = None,
) -> Truncation:
    """The fewest singular triplets whose product has a signal-to-noise ratio.

    The number that is looked at doubles until it is enough.

    Args:
        matrices: of a BTF.
        snr: least ratio in dB.
        generator, progress: as of `factorize`.

    Raises:
        ConfigError: all triplets do not reach the ratio, as their numbers are rounded.
        DataError: a picture cannot be decoded, or a value is not valid.
    """
    most, counted = DEFAULT_COMPONENTS, _Counted(matrices, progress)
    while True:
        most = min(most, matrices.full_rank)
        rank = min(most + OVERSAMPLING, matrices.full_rank)
        subspace = _Subspace.of(counted, rank, generator)
        errors = subspace.errors()[: most + 1]  # [most + 1], falling
        reached = errors <= subspace.energy * 10.0 ** (-0.1 * snr)
        if bool(reached[-1]):
            return subspace.truncated(max(int(reached.int().argmax()), 1))
        if most == matrices.full_rank:
            best = snr_db(subspace.energy, float(errors[-1]))
            raise ConfigError(
                f"snr is {snr:g} dB; expected {best:.1f} at most, which all {most} components of "
                f"{matrices.btf.name} reach; give a smaller number or write another format."
            )
        most *= 2


class _Counted:
    """Passes over the blocks of matrices, with their texels counted."""

    def __init__(self, matrices: Matrices, progress: Progress | None) -> None:
        self.matrices = matrices
        self._progress = progress
        self._done = self._total = 0

    def begin(self) -> None:
        """Adds the passes of one decomposition to the total."""
        self._total += PASSES * self.matrices.btf.texel_count

    def blocks(self) -> Iterator[Tensor]:
        """The rows `[matrices, n, width]` of each block of texels."""
        for block in self.matrices.blocks():
            yield block
            self._done += block.shape[1]
            if self._progress is not None:
                self._progress(self._done, self._total)


@dataclass(frozen=True)
class _Subspace:
    """The matrices in a subspace of few dimensions, near the one of their leading triplets.

    Randomized subspace iteration [Halko, Martinsson, Tropp 2011, Alg. 4.4] with M^T M, so that
    memory holds only the basis and the coordinates.

    Args:
        basis: orthonormal columns `[width, rank]` of each matrix, on the CPU.
        coordinates: coordinates of the rows `[T, rank]`.
        squares: squared singular values `[rank]` of the coordinates, float64, ascending.
        vectors: right singular vectors `[rank, rank]` of the coordinates, in columns.
        energy: sum of squares of all matrices.
        outside: sum of squares of their parts outside of the subspace.
    """

    basis: Tensor
    coordinates: Tensor
    squares: Tensor
    vectors: Tensor
    energy: float
    outside: float

    @classmethod
    def of(cls, counted: _Counted, rank: int, generator: torch.Generator) -> _Subspace:
        """The subspace of a rank, found in `PASSES` passes."""
        counted.begin()
        source = counted.matrices
        shape = (source.count, source.width, rank)
        basis = torch.randn(shape, generator=generator, dtype=source.dtype).to(source.device)
        for _ in range(POWER_ITERATIONS + 1):
            image = torch.zeros_like(basis)
            for block in counted.blocks():
                image += block.mT @ (block @ basis)
            basis = torch.linalg.qr(image).Q  # [matrices, width, rank]
        parts, energy, outside = [], 0.0, 0.0
        for block in counted.blocks():
            part = block @ basis
            energy += float(block.double().square().sum())
            outside += float((block - part @ basis.mT).double().square().sum())
            parts.append(part.cpu())
        coordinates = torch.cat(parts, dim=1)  # [matrices, T, rank]
        gram = coordinates.mT.double() @ coordinates.double()
        squares, vectors = torch.linalg.eigh(gram)
        return cls(basis.cpu(), coordinates, squares.clamp_min(0.0), vectors, energy, outside)

    def errors(self) -> Tensor:
        """Sums of squares that are left out by 0, 1, ... rank leading triplets, `[rank + 1]`."""
        tails = self.squares.sum(dim=0).cumsum(dim=0).flip(0)  # [rank], of 0, 1, ... triplets
        return torch.cat((tails, tails.new_zeros(1))) + self.outside

    def truncated(self, components: int) -> Truncation:
        """The leading triplets."""
        parts = zip(self.basis, self.coordinates, self.squares, self.vectors, strict=True)
        factors = []
        for basis, coordinates, squares, vectors in parts:
            turn = vectors[:, -components:].flip(1).to(basis.dtype)
            singular_values = squares[-components:].flip(0).sqrt()
            factors.append((singular_values, basis @ turn, coordinates @ turn))
        return Truncation(factors, self.energy, float(self.errors()[components]))
