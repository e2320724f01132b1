"""An independent judge: Mitsuba's own chi-square test, through its adapter for materials."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.config.synthesis import FAST
from spmm_torch.synthesize.variant import works
from tests.chi2 import LEVEL, SIGNIFICANCE, TEST_COUNT
from tests.lobes.lobe_cases import CASES, Case

pytest.importorskip("mitsuba", reason="needs the extra: pip install 'spmm_torch[mitsuba]'")

# Mitsuba integrates by the trapezoid rule in even cells, which resolves wide lobes only.
WIDE = [param for param in CASES if "wide" in param.id and "tilted" in param.id]


def to_torch(vectors: Any) -> Tensor:
    """Mitsuba's `[3, N]` arrays as `[N, 3]`."""
    return torch.from_numpy(np.array(vectors).T.reshape(-1, 3).astype(np.float64))


def planted_material(mitsuba: Any, case: Case) -> Callable[[Any], Any]:
    """What makes a BSDF of Mitsuba (whose wi is our wo) from a case."""

    class Planted(mitsuba.BSDF):
        def __init__(self, properties: Any) -> None:
            mitsuba.BSDF.__init__(self, properties)
            self.m_flags = mitsuba.BSDFFlags.GlossyReflection | mitsuba.BSDFFlags.FrontSide
            self.m_components = [self.m_flags]

        def sample(self, ctx: Any, si: Any, first: Any, others: Any, active: bool = True) -> Any:
            u = to_torch(mitsuba.Vector3f(first, others.x, others.y))
            result = mitsuba.BSDFSample3f()
            result.wo = mitsuba.Vector3f(case.sample(u).T.numpy().astype(np.float32))
            return result, mitsuba.Color3f(1.0) + 0.0 * first

        def pdf(self, ctx: Any, si: Any, wo: Any, active: bool = True) -> Any:
            return mitsuba.Float(case.pdf(to_torch(wo)).numpy().astype(np.float32))

    return Planted


@pytest.mark.parametrize("case", WIDE)
def test_mitsuba_accepts(case: Case) -> None:
    if not works(FAST):
        pytest.skip(f"mitsuba.chi2 needs the variant {FAST}, and so a libLLVM of 19 or newer")
    import mitsuba

    mitsuba.set_variant(FAST)
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    mitsuba.register_bsdf("planted_lobe", planted_material(mitsuba, case))
    functors = BSDFAdapter("planted_lobe", {"type": "planted_lobe"}, wi=case.wo.tolist())
    judge = ChiSquareTest(SphericalDomain(), *functors, 3, sample_count=100_000, res=51, ires=8)
    judge.run(SIGNIFICANCE, TEST_COUNT, quiet=True)
    assert not judge.fail, judge.messages
    assert judge.p_value > LEVEL, judge.messages
