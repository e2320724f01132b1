"""Mitsuba with the plug-ins, in a variant that works here."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from spmm_torch.config.synthesis import FAST, PLAIN
from spmm_torch.synthesize.variant import works

CUDA = "cuda_ad_rgb"


def _registered(variant: str) -> Any:
    mitsuba = pytest.importorskip("mitsuba", reason="needs the extra mitsuba")
    from spmm_torch.mitsuba import register

    mitsuba.set_variant(variant)
    register()
    return mitsuba


@pytest.fixture
def mi() -> Any:
    """Mitsuba on wavefronts, with gradients."""
    if not works(FAST):
        pytest.skip(f"needs the variant {FAST}, and so a libLLVM of 19 or newer")
    return _registered(FAST)


@pytest.fixture
def cuda() -> Iterator[Any]:
    """Mitsuba on a GPU."""
    if not works(CUDA):
        pytest.skip(f"needs the variant {CUDA}, and so a driver with OptiX")
    yield _registered(CUDA)


@pytest.fixture
def scalar() -> Iterator[Any]:
    """Mitsuba ray by ray."""
    yield _registered(PLAIN)
