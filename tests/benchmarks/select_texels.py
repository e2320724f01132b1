"""Stage select at full size, against the bare product D^T Y.

`python -m tests.benchmarks.select_texels [--texels 65536] [--lobes 100] [--threads 2]`

The sample is tiled to so many texels of 8-bit codes, clustered and searched as by default; of the
lobes found, those of the best fits make the dictionary. The bare product multiplies it with values
of as many texels that lie ready, as floats, channels first.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace

import torch
from torch import Tensor

from spmm_torch import FitConfig, load_btf
from spmm_torch.benchmark.materials import gains, repeated
from spmm_torch.data import BTF, sample_path
from spmm_torch.data.codes import MemoryCodes
from spmm_torch.data.error_weights import UNIFORM
from spmm_torch.data.store import CodeStore, Loading
from spmm_torch.fit.cluster import cluster_texels, sample_texels
from spmm_torch.fit.dictionary import Dictionary, build_dictionary
from spmm_torch.fit.problem import Problem
from spmm_torch.fit.search.lobes import search_lobes
from spmm_torch.fit.select.clusters import fit_texels
from spmm_torch.metrics import Totals
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.memory import slices
from spmm_torch.runtime.stopwatch import Stopwatch

CPU = torch.device("cpu")
# Texels of one product: as many as fill the second-level caches many times over.
PRODUCT_TEXELS = 512
STAGES = ("select", "residual")


def tiled_codes(side: int) -> BTF:
    """The sample repeated over `side * side` texels of 8-bit codes, with gains."""
    btf = load_btf(sample_path())
    store = btf.open_store(btf.part, Loading())
    assert isinstance(store, CodeStore)
    texel, gain = repeated(btf, side), gains(side, btf.channels)
    codes = torch.empty(len(texel), btf.pair_count, btf.channels, dtype=torch.uint8)
    for block in slices(len(texel), PRODUCT_TEXELS):
        codes[block] = (store.codes.rows(texel[block]) * gain[block, None]).round_().byte()
    whole = CodeStore(MemoryCodes(codes), store.expand, store.level)
    return replace(btf, height=side, width=side, open_store=lambda part, loading: whole)


def shortened(dictionary: Dictionary, lobes: int) -> Dictionary:
    """The first lobes of a dictionary, open to all clusters."""
    kept = torch.arange(min(lobes, len(dictionary.atoms)))
    choices = [kept] * len(dictionary.choices)
    atoms = dictionary.atoms[kept]
    return Dictionary(dictionary.lobes[kept], atoms, dictionary.norm[kept], choices, atoms)


def bare_product(btf: BTF, atoms: Tensor) -> float:
    """Seconds of D^T Y for all texels."""
    values = btf.texels(slice(0, PRODUCT_TEXELS)).transpose(1, 2).contiguous()
    torch.matmul(values, atoms.T)  # touches the memory
    started = time.perf_counter()
    for _ in slices(btf.texel_count, PRODUCT_TEXELS):
        torch.matmul(values, atoms.T)
    return time.perf_counter() - started


@torch.no_grad()
def main() -> None:
    """Prints seconds, their ratio, and the errors of the fit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--texels", type=int, default=65536)
    parser.add_argument("--lobes", type=int, default=100)
    parser.add_argument("--pilot", type=int, default=FitConfig().select.pilot, help="0: none")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    btf = tiled_codes(math.isqrt(options.texels))
    config = FitConfig.from_dict({"select": {"pilot": options.pilot or None}})
    watch = Stopwatch(CPU)
    context = Context.build("cpu", config.seed, memory=1 << 33, watch=watch)
    problem = Problem.build(btf, UNIFORM, config, context)
    clusters = cluster_texels(problem)
    found = search_lobes(problem, sample_texels(problem, clusters))
    dictionary = build_dictionary(problem, found, len(clusters.members))
    dictionary = shortened(dictionary, options.lobes)
    bare = bare_product(btf, dictionary.atoms)
    fits = fit_texels(problem, clusters, dictionary)
    errors = Totals.sum(fit.totals for fit in fits).snr_db()
    seconds = {part: watch.seconds[part] for part in STAGES}
    print(f"{btf.texel_count} texels, {len(dictionary.atoms)} lobes")
    for part, value in {"bare product": bare, **seconds}.items():
        print(f"{part:14} {value:8.2f} s   {value / bare:6.2f} x")
    print(f"{'all of them':14} {sum(seconds.values()):8.2f} s", end="   ")
    print(f"{sum(seconds.values()) / bare:6.2f} x")
    print(f"SNR {errors}")


if __name__ == "__main__":
    main()
