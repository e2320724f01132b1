"""Squared errors of a model against scattered samples, list by list and block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..data.pair_lists import PairList
from ..data.scattered_btf import ScatteredBTF
from ..errors import DataError
from ..metrics import Totals, snr_db
from ..model.spmm import SPMM
from ..runtime.memory import blocks_of, slices
from .angles import BAND_MIDDLES, BANDS, AngleTable, band
from .predictions import Tabulated
from .worst import LISTED, degrees

# Values of all lobes, and of texels, at a block of pairs.
BLOCK_VALUES = 1 << 22
# Texels under one block of pairs, at most.
BLOCK_TEXELS = 1 << 12


@dataclass(frozen=True)
class SampleErrors:
    """Sums of squares over scattered samples and channels, float64 on the CPU.

    Attributes:
        energy, without_residual, with_residual: of all texels.
        texel_energy, texel_error: of each texel `[T]`, the error of the whole model.
        table: by bands of polar angles.
        worst: samples of the largest errors, the worst one first.
    """

    energy: float
    without_residual: float
    with_residual: float
    texel_energy: Tensor
    texel_error: Tensor
    table: AngleTable
    worst: list[dict[str, Any]]

    def totals(self) -> Totals:
        """The sums; texels that share no pairs have no mean."""
        return Totals(self.energy, self.without_residual, self.with_residual, float("nan"))


@torch.no_grad()
def sample_errors(
    model: SPMM, btf: ScatteredBTF, progress: Callable[[int], object] = lambda count: None
) -> SampleErrors:
    """Evaluates a model at every sample.

    Args:
        model: on the device of the computation; it may have been fit to other samples.
        btf: texels of the model.
        progress: called with the number of texels just done.

    Raises:
        DataError: the model has a relief, through which a texel shows others.
    """
    if model.relief is not None:
        raise DataError(
            f"the model {model.name!r} has a relief, and {btf.path or btf.name} holds scattered "
            f"samples of texels; expected a model of a flat surface; fit one by relief.mode=off."
        )
    sums = _Sums.of(btf.texel_count)
    lobes = len(model.dictionary)
    # Short lists by so many as one table holds.
    for some in blocks_of(btf.lists, lambda part: len(part.wi) * _rows(part, lobes), BLOCK_VALUES):
        _add_lists(sums, model, some)
        progress(sum(len(part.texels) for part in some))
    return sums.result()


def _rows(part: PairList, lobes: int) -> int:
    """Values at each pair of a list that are held at once."""
    return max(1, lobes, min(len(part.texels), BLOCK_TEXELS))


def _add_lists(sums: _Sums, model: SPMM, parts: list[PairList]) -> None:
    """Adds the samples of a long list, or of several short ones."""
    if len(parts) == 1:
        (part,) = parts
        step = max(1, BLOCK_VALUES // _rows(part, len(model.dictionary)))
        for pairs in slices(len(part.wi), step):
            some = part.at(torch.arange(pairs.start, pairs.stop))
            _add_table(sums, Tabulated.of_pairs(model, some.wi, some.wo), [some])
        return
    wi, wo = (torch.cat([getattr(part, side) for part in parts]) for side in ("wi", "wo"))
    _add_table(sums, Tabulated.of_pairs(model, wi, wo), parts)


def _add_table(sums: _Sums, table: Tabulated, parts: list[PairList]) -> None:
    """Adds lists whose pairs are those of a table, one list after another."""
    start = 0
    for part in parts:
        pairs = slice(start, start + len(part.wi))
        for texels in slices(len(part.texels), BLOCK_TEXELS):
            sums.add(table, part, texels, pairs)
        start = pairs.stop


@dataclass
class _Sums:
    """Sums so far: `[T, 3]` of energy and of the errors without and with residual; by bands
    `[bands, bands, 2]`; and the largest errors with their samples."""

    texel: Tensor
    bands: Tensor
    worst: list[tuple[float, dict[str, Any]]]

    @classmethod
    def of(cls, texels: int) -> _Sums:
        """Zeros."""
        double = torch.float64
        sums = (torch.zeros(texels, 3, dtype=double), torch.zeros(BANDS, BANDS, 2, dtype=double))
        return cls(*sums, [])

    def add(self, table: Tabulated, part: PairList, texels: slice, pairs: slice) -> None:
        """Adds some texels at all pairs of a part of a list, which are those `pairs` of a table."""
        own, device = part.texels[texels], table.rho.device
        value = part.values[texels].to(device)
        place = own.to(device)
        lobes = table.lobes_of(table.model.sparse_weights.of(place), pairs)
        whole = lobes + table.residual(place, pairs)
        squares = [value, lobes - value, whole - value]
        square = torch.stack([each.double().square().sum(-1) for each in squares], -1).cpu()
        self.texel[own] += square.sum(1)  # [n, d, 3]
        cell = BANDS * band(part.wo) + band(part.wi)  # [d]
        self.bands.view(-1, 2).index_add_(0, cell, square.sum(0)[:, [0, 2]])
        self._keep_worst(part, own, square)

    def _keep_worst(self, part: PairList, own: Tensor, square: Tensor) -> None:
        """Keeps the largest errors of these samples and of those before."""
        count = len(part.wi)
        least = self.worst[-1][0] if len(self.worst) == LISTED else -1.0
        found = square[..., 2].flatten().topk(min(LISTED, square[..., 2].numel()))
        for error, index in zip(found.values.tolist(), found.indices.tolist(), strict=True):
            if error <= least:
                break
            row, pair = divmod(index, count)
            energy = float(square[row, pair, 0])
            entry = {
                "texel": int(own[row]),
                "light": degrees(part.wi[pair]),
                "view": degrees(part.wo[pair]),
                "snr_db": snr_db(energy, error) if energy > 0.0 else None,
            }
            self.worst.append((error, entry))
        self.worst = sorted(self.worst, key=lambda one: -one[0])[:LISTED]

    def result(self) -> SampleErrors:
        """What was summed."""
        energy, without, whole = self.texel.sum(0).tolist()
        table = AngleTable(BAND_MIDDLES, BAND_MIDDLES, self.bands[..., 0], self.bands[..., 1])
        worst = [
            {**entry, "error_share": error / whole} for error, entry in self.worst if error > 0.0
        ]
        return SampleErrors(
            energy, without, whole, self.texel[:, 0], self.texel[:, 2], table, worst
        )
