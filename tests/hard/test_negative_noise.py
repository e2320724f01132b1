"""Noise about zero: what keeping and clipping make of it."""

from __future__ import annotations

import pytest

from spmm_torch import DataError, FitConfig
from spmm_torch.fit import fit
from tests.hard.cases import DARK, QUICK, noisy, snr_between

LEVEL = 0.2


def test_refused_by_default() -> None:
    with pytest.raises(DataError, match="give data.negative"):
        noisy(LEVEL, "refuse", truth=DARK)


def test_keeping_is_nearer_to_the_truth_than_clipping() -> None:
    """Clipped noise no longer averages out: it adds light where there is none."""
    kept, clipped = noisy(LEVEL, truth=DARK), noisy(LEVEL, "clip", truth=DARK)
    assert float(kept.texels().min()) < 0.0 == float(clipped.texels().min())
    config = FitConfig.from_dict(QUICK)
    snr = [snr_between(fit(btf, config), DARK) for btf in (kept, clipped)]
    assert snr[0] >= snr[1] + 6.0
    assert snr[0] >= 25.0
