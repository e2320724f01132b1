"""A model at a million (uv, wi, wo), against the least that this takes.

`python -m tests.benchmarks.evaluate_triples [--threads 2] [--count 1000000] [--model RUN]`

The least: a bare gather of the weights of the four texels around every query, plus the values of
all their lobes by a kernel that torch.compile fuses for each BRDF (which needs a C++ compiler), on
arrays that lie ready. The model has 256 x 256 texels of 8 lobes each, or is that of a run, whose
number of lobes a texel varies: then its own ways alone are compared, as it stands and compiled. The
planted model is also asked with components in place of the cluster residual, and over a relief.
"""

from __future__ import annotations

import argparse
import functools
import math
import time
from collections.abc import Callable

import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.geometry.directions import direction_from_angles, texel_at
from spmm_torch.lobes.batch import CPU_BLOCK, LobeBatch
from spmm_torch.lobes.values import eval_model
from tests.benchmarks.render_sphere import CLUSTER_LOBES, CLUSTERS, LOBES, TEXELS, best_time
from tests.planted.models import planted_model, planted_relief, with_components, with_relief

# Components in place of the cluster residual, and depth of a relief, in texture widths.
RANK, DEPTH = 8, 0.05
# Directions to which a lobe is applied at once in the fused kernels.
ROW = 128


def queries(count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Random uv `[count, 2]`, wi and wo `[count, 3]`, all above the horizon."""
    generator = torch.Generator().manual_seed(0)
    uv = torch.rand(count, 2, generator=generator)
    angles = torch.rand(2, 2, count, generator=generator)
    wi, wo = (direction_from_angles(1.5 * theta, 6.28 * phi) for theta, phi in angles)
    return uv, wi, wo


def gather(model: SPMM, uv: Tensor) -> Tensor:
    """The weights `[count, 4 LOBES, C]` of the four texels around every uv."""
    texel, _ = texel_at(uv, model.height, model.width)
    entry = model.offset[texel][..., None] + torch.arange(LOBES)  # [count, 4, LOBES]
    return model.weight.index_select(0, entry.flatten())


def fused_values(lobes: LobeBatch, wi: Tensor, wo: Tensor, values: int) -> Callable[[], None]:
    """What evaluates `values` values of lobes, evenly spread over their models."""
    kernels = []
    for index in torch.unique(lobes.model).tolist():
        rows = torch.nonzero(lobes.model == index).squeeze(-1)
        rows = rows.repeat(-(-CPU_BLOCK // ROW // len(rows)))[: CPU_BLOCK // ROW]
        part = lobes[rows]
        at = torch.arange(CPU_BLOCK) % len(wi)
        directions = [w[at].view(-1, ROW, 3).movedim(-1, 0).contiguous() for w in (wi, wo)]
        kernel = torch.compile(functools.partial(eval_model, index), dynamic=False)
        local = [w.movedim(0, -1) for w in directions]
        kernels.append(functools.partial(kernel, part.kappa, part.normal, part.angle, *local))

    def work() -> None:
        for number in range(-(-values // CPU_BLOCK)):
            kernels[number % len(kernels)]()

    return work


def compiled(model: SPMM, uv: Tensor, wi: Tensor, wo: Tensor) -> dict[str, Callable[[], object]]:
    """The compiled model without and with residual, compiled here for another size of the batch."""
    call, calls = torch.compile(model, dynamic=True, fullgraph=True), {}
    for name, residual in (("compiled", False), ("compiled with residual", True)):
        few = (part[:1000].clone() for part in (uv, wi, wo))  # a view is compiled for its base
        start = time.perf_counter()
        call(*few, residual)
        print(f"{name:24} {time.perf_counter() - start:8.3f} s to compile")
        calls[name] = functools.partial(call, uv, wi, wo, residual)
    return calls


@torch.no_grad()
def main() -> None:
    """Prints seconds and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--model", help="run, in place of the planted model")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    planted = options.model is None
    if planted:
        model = planted_model(TEXELS, LOBES, CLUSTERS, CLUSTER_LOBES)
    else:
        model = SPMM.load(options.model)
    uv, wi, wo = queries(options.count)
    work: dict[str, Callable[[], object]] = {
        "model": lambda: model(uv, wi, wo, residual=False),
        "with residual": lambda: model(uv, wi, wo),
        **compiled(model, uv, wi, wo),
    }
    if planted:
        rank = with_components(model, RANK)
        work[f"with {RANK} components"] = lambda: rank(uv, wi, wo)
        raised = with_relief(model, planted_relief(TEXELS, TEXELS, DEPTH))
        work["over a relief"] = lambda: raised(uv, wi, wo)
        work["gather"] = lambda: gather(model, uv)
        work["fused lobes"] = fused_values(
            model.dictionary.detach(), wi, wo, 4 * LOBES * options.count
        )
    seconds = {part: best_time(call, "cpu", options.repeats) for part, call in work.items()}
    least = seconds.get("gather", math.nan) + seconds.get("fused lobes", math.nan)
    for part, value in seconds.items():
        ratio = f"   {value / least:5.2f} times the least" if planted else ""
        print(f"{part:24} {value:8.3f} s{ratio}")


if __name__ == "__main__":
    main()
