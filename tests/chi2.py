"""Chi-square tests of samplers against their densities, with their own quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from scipy.stats import chi2
from torch import Tensor

# Over all tests of all samplers together, fewer than TEST_COUNT, by Sidak's correction. Nine BRDFs
# make 305 of them, each more at most 33.
SIGNIFICANCE = 0.01
TEST_COUNT = 600
LEVEL = 1.0 - (1.0 - SIGNIFICANCE) ** (1.0 / TEST_COUNT)
MIN_EXPECTED = 5.0
# Gauss-Legendre nodes along each side of a cell; what two depths disagree about is cut in four.
NODES = 4
MAX_DEPTH = 10
# Standard errors by which a count surprises, and the depth its cell is then cut to at least.
SURPRISE, SURPRISE_DEPTH = 2.5, 3
# Probability that may be wrong in one cell, as a share of the standard error of its count.
TOLERANCE = 0.02
MASS_ERROR = 1e-4
BLOCK = 1 << 19


@dataclass(frozen=True)
class Grid:
    """Cells of the upper hemisphere, rectangles of z = cos(theta) and phi in [-pi, pi]."""

    z: Tensor  # [Z + 1] edges
    phi: Tensor  # [F + 1] edges

    @classmethod
    def around(cls, wi: Tensor, rows: int, columns: int) -> Grid:
        """Half of the edges even, half at quantiles of samples `wi [N, 3]`, to resolve lobes."""
        phi = torch.atan2(wi[:, 1], wi[:, 0])
        return cls(_edges(wi[:, 2], 0.0, 1.0, rows), _edges(phi, -math.pi, math.pi, columns))

    def counts(self, wi: Tensor) -> Tensor:
        """How many of `wi [N, 3]` each cell holds, `[Z * F]`."""
        phi = torch.atan2(wi[:, 1], wi[:, 0])
        row = torch.bucketize(wi[:, 2].clamp(0.0, 1.0), self.z[1:-1])
        column = torch.bucketize(phi, self.phi[1:-1])
        columns = len(self.phi) - 1
        return torch.bincount(row * columns + column, minlength=(len(self.z) - 1) * columns)

    def integrate(
        self, pdf: Callable[[Tensor], Tensor], count: int, observed: Tensor | None = None
    ) -> Tensor:
        """The integral of pdf over each cell `[Z * F]`, good enough for `count` samples.

        A cell whose `observed` number of samples surprises is done again from finer parts: a
        narrow lobe may have passed between the nodes.
        """
        low = torch.cartesian_prod(self.z[:-1], self.phi[:-1])
        high = torch.cartesian_prod(self.z[1:], self.phi[1:])
        box = torch.stack((low, high), dim=1)  # [B, 2 ends, 2 coordinates]
        total = _adaptive(pdf, box, count, 0)
        if observed is None:
            return total
        expected = count * total
        odd = (observed - expected).abs() > SURPRISE * torch.sqrt(expected + 1.0)
        total[odd] = _adaptive(pdf, box[odd], count, SURPRISE_DEPTH)
        return total


def _adaptive(pdf: Callable[[Tensor], Tensor], box: Tensor, count: int, least_depth: int) -> Tensor:
    """Integrals of pdf over boxes `[B, 2, 2]`, cut in four until two depths agree."""
    cell, total = torch.arange(len(box)), torch.zeros(len(box), dtype=torch.float64)
    rough = _quadrature(pdf, box)
    for depth in range(MAX_DEPTH):
        quarters = _quarters(box)  # [B, 4, 2, 2]
        fine = _quadrature(pdf, quarters.flatten(0, 1)).view(-1, 4)
        error = TOLERANCE * torch.sqrt(fine.sum(1).clamp(min=1.0 / count) / count)
        agree = (fine.sum(1) - rough).abs() < error / 2**depth
        done = (agree & (depth >= least_depth)) | (depth == MAX_DEPTH - 1)
        total.index_add_(0, cell[done], fine[done].sum(1))
        box, rough = quarters[~done].flatten(0, 1), fine[~done].flatten()
        cell = cell[~done].repeat_interleave(4)
        if not len(box):
            break
    return total


def _edges(values: Tensor, low: float, high: float, count: int) -> Tensor:
    """`count + 1` edges: half even, half at quantiles of `values`."""
    even = torch.linspace(low, high, count // 2 + 1, dtype=torch.float64)
    inner = torch.linspace(0.0, 1.0, count - count // 2 + 2, dtype=torch.float64)[1:-1]
    quantiles = torch.quantile(values[: 1 << 20].double(), inner)
    return torch.cat((even, quantiles)).unique()


def _quarters(box: Tensor) -> Tensor:
    """Boxes `[B, 2, 2]` cut in four: `[B, 4, 2, 2]`."""
    low, high = box[:, 0], box[:, 1]
    half = 0.5 * (high - low)
    corners = torch.tensor([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]], dtype=torch.float64)
    start = low[:, None] + corners * half[:, None]
    return torch.stack((start, start + half[:, None]), dim=2)


def _quadrature(pdf: Callable[[Tensor], Tensor], box: Tensor) -> Tensor:
    """Gauss-Legendre integrals of pdf over boxes `[B, 2, 2]`."""
    return torch.cat([_quadrature_block(pdf, part) for part in box.split(BLOCK // NODES**2)])


def _quadrature_block(pdf: Callable[[Tensor], Tensor], box: Tensor) -> Tensor:
    inner = torch.arange(1.0, NODES, dtype=torch.float64)
    beta = inner / torch.sqrt(4.0 * inner * inner - 1.0)
    node, vectors = torch.linalg.eigh(torch.diag(beta, 1) + torch.diag(beta, -1))  # Golub-Welsch
    weight = vectors[0] ** 2  # sums to 1
    at = torch.cartesian_prod(node, node)  # [NODES^2, 2]
    share = torch.cartesian_prod(weight, weight).prod(dim=1)
    middle, half = box.mean(dim=1), 0.5 * (box[:, 1] - box[:, 0])
    z, phi = (middle[:, None] + half[:, None] * at).unbind(-1)  # [B, NODES^2]
    radius = torch.sqrt((1.0 - z * z).clamp(min=0.0))
    wi = torch.stack((radius * torch.cos(phi), radius * torch.sin(phi), z), dim=-1)
    value = pdf(wi.view(-1, 3)).view(z.shape).double()
    return (value @ share) * 4.0 * half.prod(dim=1)


@dataclass(frozen=True)
class Outcome:
    """What a test found.

    Attributes:
        p_value: how often a true density would look worse.
        mass: integral of the density over the upper hemisphere.
        cells: cells that were compared, after pooling.
    """

    p_value: float
    mass: float
    cells: int

    @property
    def accepted(self) -> bool:
        """Whether the density is that of the samples, and normalized."""
        return self.p_value > LEVEL and abs(self.mass - 1.0) < MASS_ERROR


def check(
    sample: Callable[[Tensor], Tensor],
    pdf: Callable[[Tensor], Tensor],
    count: int,
    rows: int,
    columns: int,
    seed: int = 0,
) -> Outcome:
    """Compares `count` samples with their density.

    Args:
        sample: takes u `[N, 3]` float64 in [0, 1) to wi `[N, 3]` in the upper hemisphere.
        pdf: its density at `[N, 3]`, `[N]`.
        rows, columns: cells along cos(theta) and phi.
        seed: of the uniform numbers.
    """
    generator = torch.Generator().manual_seed(seed)
    pilot = sample(torch.rand(20_000, 3, generator=generator, dtype=torch.float64))
    grid = Grid.around(pilot, rows, columns)
    u = torch.rand(count, 3, generator=generator, dtype=torch.float64)
    wi = torch.cat([sample(part) for part in u.split(BLOCK)])
    assert bool((wi[:, 2] > 0.0).all()), "a sample under the horizon"
    observed = grid.counts(wi)
    probability = grid.integrate(pdf, count, observed)
    statistic, cells = pooled_statistic(observed.double(), count * probability)
    return Outcome(float(chi2.sf(statistic, cells - 1)), float(probability.sum()), cells)


def pooled_statistic(observed: Tensor, expected: Tensor) -> tuple[float, int]:
    """Pearson's statistic over cells `[N]`; those that expect too few are joined until enough."""
    order = torch.argsort(expected)
    observed, expected = observed[order], expected[order]
    small = int((expected < MIN_EXPECTED).sum())
    # A pool closes where its sum passes the next multiple, so each but the last expects enough.
    pool = torch.floor(expected[:small].cumsum(0) / (2.0 * MIN_EXPECTED)).long()
    pools = int(pool[-1]) + 1 if small else 0
    label = torch.cat((pool, torch.arange(pools, pools + len(expected) - small)))
    if pools and float(expected[:small][pool == pools - 1].sum()) < MIN_EXPECTED:
        label = (label - 1).clamp(min=0) if pools == 1 else label - (label >= pools - 1).long()
    size = int(label[-1]) + 1
    zeros = torch.zeros(size, dtype=torch.float64)
    expected, observed = zeros.index_add(0, label, expected), zeros.index_add(0, label, observed)
    return float(((observed - expected) ** 2 / expected).sum()), size
