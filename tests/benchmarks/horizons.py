"""What the smooth horizon of lobes costs and mends: `python -m tests.benchmarks.horizons`.

Fits the bundled sample and ROCKS64 of the test data by `configs/fast.yaml` with steps of several
widths. Turns of the view by 0.019 degrees, a hundredth of a pixel of a sphere, show the jumps.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F

from spmm_torch import SPMM, FitConfig, load_btf
from spmm_torch.data import sample_path
from spmm_torch.fit import fit
from spmm_torch.geometry.directions import direction_from_angles
from tests.locations import CONFIGS, data_file

DEGREES = (0.0, 2.0, 5.0, 10.0, 15.0)
# Polar angle of the light and azimuths of the paths of the view, in radians.
LIGHT, AZIMUTHS = 0.5, (0.3, 2.4, 4.5)
TURN, LOWEST_VIEW = math.radians(0.019), math.radians(75.0)
BLOCK = 1024


@torch.no_grad()
def largest_jumps(model: SPMM) -> torch.Tensor:
    """Largest relative change of each texel's lobes by one turn of the view, `[T]`."""
    weight, offset = model.weight.mean(1), model.offset
    theta = torch.arange(0.0, LOWEST_VIEW, TURN, dtype=torch.float64)
    wi = torch.tensor([[math.sin(LIGHT), 0.0, math.cos(LIGHT)]])
    worst = torch.zeros(model.texel_count)
    for azimuth in AZIMUTHS:
        views = direction_from_angles(theta, torch.full_like(theta, azimuth)).float()
        rho = model.dictionary.eval_grid(wi, views)  # [J, V]
        for texels in torch.arange(model.texel_count).split(BLOCK):
            first, last = int(offset[texels[0]]), int(offset[texels[-1] + 1])
            value = F.embedding_bag(
                model.index[first:last],
                rho,
                offset[texels] - first,
                mode="sum",
                per_sample_weights=weight[first:last],
            )
            change = (value[:, 1:] - value[:, :-1]).abs()
            jump = change / torch.maximum(value[:, 1:], value[:, :-1]).clamp(min=1e-4)
            worst[texels] = torch.maximum(worst[texels], jump.amax(1))
    return worst


def main() -> None:
    """Prints a row for each material and width."""
    for path in (sample_path(), data_file("ROCKS64.zip")):
        for degrees in DEGREES:
            config = FitConfig.from_yaml(CONFIGS / "fast.yaml")
            result = fit(
                load_btf(path), config.changed({"dictionary.horizon": degrees}), render=False
            )
            snr, jumps = result.report["snr_db"], largest_jumps(result.model)
            print(
                f"{path.stem} {degrees:4g} degrees: lobes {snr['without_residual']:6.3f} dB, with "
                f"residual {snr['with_residual']:6.3f} dB, texels with a jump over 5 %: "
                f"{float((jumps > 0.05).float().mean()):.1%}, over 1 %: "
                f"{float((jumps > 0.01).float().mean()):.1%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
