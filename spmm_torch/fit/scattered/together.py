"""Weights of the texels of many short lists at once, each by its own Gram matrix.

A list of a few dozen pairs takes longer to call for than to compute.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from ...config.fit import SelectConfig
from ...data.pair_lists import PairedBTF, PairList
from ...lobes.batch import LobeBatch
from ...lobes.grid import DirectionGrid
from ...metrics import Totals
from ...runtime.memory import blocks_of
from ...solvers.foba import select_foba
from ...solvers.status import Solver, StatusCounts
from ..problem import Problem
from ..select.products import squared_norms
from .listed import ListFit, limited
from .weights import list_weights

# Lists of so many pairs, and so many texels, at most, are fit together.
SHORT_PAIRS, FEW_TEXELS = 1 << 9, 1 << 3
# Values of all lobes at the pairs of all texels of one block, and entries of their Gram matrices.
BLOCK_VALUES = 1 << 22


def is_short(part: PairList, config: SelectConfig) -> bool:
    """Whether a list is fit together with others."""
    few = len(part.wi) <= SHORT_PAIRS and len(part.texels) <= FEW_TEXELS
    return few and config.method == "corrective"


def fit_together(
    parts: Sequence[PairList], lobes: LobeBatch, problem: Problem
) -> Iterator[ListFit]:
    """The fits of the texels of short lists, those of like length together."""
    config = problem.config.select
    for block in _blocks(parts, len(lobes), config):
        yield _fit_block(block, lobes, problem, limited(config, len(block[0].wi)))


def _blocks(
    parts: Sequence[PairList], lobes: int, config: SelectConfig
) -> Iterator[list[PairList]]:
    """Lists in the order of their lengths, in blocks that may have as many lobes a texel."""
    ordered = sorted(parts, key=lambda part: len(part.wi))
    for _, alike in groupby(ordered, lambda part: limited(config, len(part.wi)).max_lobes):
        yield from blocks_of(
            alike, lambda part: len(part.texels) * lobes * max(len(part.wi), lobes), BLOCK_VALUES
        )


def _fit_block(
    parts: list[PairList], lobes: LobeBatch, problem: Problem, config: SelectConfig
) -> ListFit:
    """The fits of the texels of some lists."""
    device = problem.device
    rho, signals, owner = _padded(parts, lobes, problem)
    norm = rho.double().square().sum(2).sqrt()  # [L, J], 0 of lobes that no pair sees
    unit = torch.where(norm > 0.0, norm, 1.0)
    gram = (rho @ rho.transpose(1, 2)).double() / (unit[:, :, None] * unit[:, None])
    found = (rho[owner] @ signals.transpose(1, 2)).double() / unit[owner][..., None]  # [T, J, C]
    energy = squared_norms(signals).sum(1)  # [T]
    chosen = select_foba(
        gram.float(),
        found.float(),
        energy,
        max_lobes=config.max_lobes,
        min_gain=config.min_gain,
        owner=owner,
    )
    weights = chosen.weights / unit[owner].gather(1, chosen.index.clamp(min=0))[..., None]
    used = (chosen.index >= 0) & (chosen.weights > 0.0).any(2)
    solvers = StatusCounts.of(Solver.FOBA, chosen.status)
    solvers += StatusCounts.of(Solver.NNLS, chosen.nnls_status)
    error = float(chosen.error.sum())
    return ListFit(
        torch.cat([part.texels for part in parts]),
        torch.where(used, chosen.index, -1).cpu(),
        (weights * used[..., None]).float().cpu(),
        Totals(float(energy.sum()), error, error, float("nan")),
        solvers.to(device="cpu") if device.type != "cpu" else solvers,
    )


def _padded(
    parts: list[PairList], lobes: LobeBatch, problem: Problem
) -> tuple[Tensor, Tensor, Tensor]:
    """Lobes and texels at the pairs of some lists, scaled, and 0 beyond the pairs of each list.

    Returns:
        (rho `[L, J, d]`, signals `[T, C, d]`, list of each texel `[T]`).
    """
    device, scales, signals = problem.device, [], []
    for part in parts:
        btf = PairedBTF.of(part)
        weights = list_weights(btf, problem.objective, device)
        scale = weights.scale(device)
        scales.append(torch.ones(len(part.wi), device=device) if scale is None else scale)
        signals.extend(weights.signals(btf, slice(0, len(part.texels)), device).transpose(1, 2))
    wi, wo = (torch.cat([getattr(part, side) for part in parts]) for side in ("wi", "wo"))
    rho = DirectionGrid.of_pairs(wi, wo, device, torch.cat(scales)).eval(lobes)  # [J, N]
    lengths = [len(part.wi) for part in parts]
    counts = torch.tensor([len(part.texels) for part in parts], device=device)
    owner = torch.arange(len(parts), device=device).repeat_interleave(counts)
    return (
        pad_sequence(list(rho.T.split(lengths)), batch_first=True).transpose(1, 2).contiguous(),
        pad_sequence(signals, batch_first=True).transpose(1, 2).contiguous(),
        owner,
    )
