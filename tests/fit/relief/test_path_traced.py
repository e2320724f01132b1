"""The relief of a path-traced BTF, with shadows, masking and inter-reflection."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.config.synthesis import SynthesisSettings
from spmm_torch.fit.relief import estimate_relief
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize.maps import TextureMaps
from spmm_torch.synthesize.pipeline import as_btf, path_trace
from tests.planted.reliefs import smooth_noise

SIDE = 96


@pytest.mark.slow
def test_path_traced_heights_are_found(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    generator = torch.Generator().manual_seed(0)
    height = smooth_noise((SIDE, SIDE), 16.0, generator)
    height = (height - height.min()) / (height.max() - height.min())
    albedo = (0.3 * (0.5 * smooth_noise((SIDE, SIDE), 2.5, generator)).exp()).clamp(max=0.9)
    maps = TextureMaps(
        height=height.numpy(),
        albedo=albedo[..., None].expand(-1, -1, 3).numpy().copy(),
        roughness=np.full((SIDE, SIDE), 0.6, np.float32),
    )
    settings = SynthesisSettings(relief=0.1, size=SIDE, samples=16)
    view = ring_directions(((0.0, 1), (20.0, 5), (40.0, 7), (58.0, 8)))
    light = ring_directions(((25.0, 3), (50.0, 3)))
    pictures = path_trace(maps, view, light, settings, tmp_path, Progress(enabled=False))
    found = estimate_relief(as_btf(np.array(pictures), view, light, "planted", hdr=True))
    assert isinstance(found.height, Tensor)
    truth = 0.1 * (height - height.mean())
    both = torch.stack((found.height.flatten(), truth.flatten()))
    assert float(torch.corrcoef(both)[0, 1]) > 0.9
    assert float(found.height.mean()) == pytest.approx(0.0, abs=0.005)
    assert found.rule == "repeat"
