"""The choice of the objective: by the data, and never for the paper's method."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import BTF, FitConfig
from spmm_torch.brdf import PAPER_MODELS
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.geometry.directions import ring_directions
from tests.fit.glossy.test_peaks import WIDTH, lobe, samples
from tests.planted.btfs import texel_btf

CPU = torch.device("cpu")
AUTO = FitConfig()
TWO_LOBES = {"search": {"max_lobes": 2, "exchanges": 0}}
PLAIN = {"weights": {"error": "l2"}}


def glossy_btf() -> BTF:
    """A mirror over a dim body."""
    return texel_btf(samples(lobe(0.012, 0.9)).transpose(1, 2), ring_directions())


def test_a_body_that_would_be_lost_beside_its_peak_chooses_balanced_errors() -> None:
    peaks = samples(lobe(1.2 * WIDTH, 0.5), body=0.0) + samples(lobe(3.0 * WIDTH, 0.04), body=0.003)
    btf, config = (
        texel_btf(peaks.transpose(1, 2), ring_directions()),
        FitConfig.from_dict(TWO_LOBES),
    )
    found = Objective.of(btf, config, CPU)
    assert (found.error, found.chosen, found.peak, found.pair) == ("balanced", True, None, None)
    assert found.models(PAPER_MODELS) == PAPER_MODELS
    assert found.models(PAPER_MODELS, each=True) == PAPER_MODELS
    assert "values and of cube roots" in (found.describe() or "")


def test_squared_errors_that_look_right_stay() -> None:
    values = samples(lobe(1.2 * WIDTH, 0.9), body=0.02).transpose(1, 2)
    found = Objective.of(texel_btf(values, ring_directions()), AUTO, CPU)
    assert (found.error, found.chosen) == ("l2", True)


def test_unresolved_peaks_choose_cube_roots() -> None:
    found = Objective.of(glossy_btf(), AUTO, CPU)
    assert (found.error, found.chosen) == ("cube-root", True)
    assert found.peak is not None and found.pair is not None
    assert found.models(PAPER_MODELS)[-1] == "ggx"
    assert "metal" in (found.describe() or "")


@pytest.mark.parametrize(
    "change",
    [PLAIN, {"search": {"method": "stagewise"}}],
)
def test_the_settings_and_the_paper_stay_plain(change: dict) -> None:
    found = Objective.of(glossy_btf(), FitConfig.from_dict(change), CPU)
    assert found.plain
    assert found.models(PAPER_MODELS, each=True) == PAPER_MODELS


def test_black_texels_and_one_bright_sample_do_not_make_data_glossy() -> None:
    values = torch.rand(4, 6561, 3, generator=torch.Generator().manual_seed(0))
    values[:3] = 0.0
    assert Objective.of(texel_btf(values, ring_directions()), AUTO, CPU).plain
    values[3, 100] = 1e4
    assert Objective.of(texel_btf(values, ring_directions()), AUTO, CPU).plain


@pytest.mark.parametrize("error", ["auto", "balanced", "cube-root", "log"])
def test_black_texels_tell_nothing_of_gloss(error: str) -> None:
    """The height of their peak, 0, was divided by; and any error suited them."""
    alone, config = glossy_btf(), FitConfig.from_dict({"weights": {"error": error}})
    black = torch.zeros_like(alone.texels())
    known = Objective.of(alone, config, CPU)
    found = Objective.of(
        texel_btf(torch.cat((black, alone.texels())), ring_directions()), config, CPU
    )
    assert (found.error, found.chosen, found.peak) == (known.error, known.chosen, known.peak)
    darkest = torch.zeros(66, 6561, 3)
    darkest[1] = 1.0  # every second texel is looked at
    unseen = Objective.of(texel_btf(darkest, ring_directions()), config, CPU)
    assert (unseen.peak, unseen.chosen) == (None, error == "auto")


def test_matt_data_choose_squared_errors() -> None:
    values = torch.rand(4, 6561, 3, generator=torch.Generator().manual_seed(0))
    found = Objective.of(texel_btf(values, ring_directions()), AUTO, CPU)
    assert found.plain
    assert found.describe() is None
    assert found.models(PAPER_MODELS) == PAPER_MODELS
    assert found.models(PAPER_MODELS, each=True) == (*PAPER_MODELS, "ggx")
    assert found.models(("lambertian",), each=True) == ("lambertian",)
