"""Our own method, whole and by part: the measure of the peers."""

from __future__ import annotations

import torch

from ...config.shipped import shipped
from ...data.error_weights import UNIFORM
from ...fit.cluster import Samples
from ...fit.dictionary import FoundLobes
from ...fit.problem import Problem as FitProblem
from ...fit.search.lobes import find_lobes
from ...fit.select.products import Products, cluster_products
from ...fit.select.target import target_beside_residual
from ...fit.select.texels import Fit, select, squared_errors
from ...metrics import snr_db
from ...runtime.context import Context
from ..protocol import Timing, measure
from ..variants import DEFAULT
from .problem import SEARCH, SELECTION, WHOLE, Peer, Problem, Row, row


def run(problem: Problem) -> list[Row]:
    """The default fit, its search on few texels, and its selection on few texels."""
    return [*_whole(problem), _search(problem), _selection(problem)]


def _whole(problem: Problem) -> list[Row]:
    report, texels = problem.ours.result.report, problem.btf.texel_count
    lobes, size = report["mean_basis_per_texel"], report["bytes"]
    timing = Timing((problem.ours.seconds_after_load,))
    return [
        row(
            "spmm, default",
            WHOLE,
            texels,
            timing,
            report["snr_db"]["with_residual"],
            size=size["total"],
            lobes=lobes,
        ),
        row(
            "spmm, default, lobes alone",
            WHOLE,
            texels,
            timing,
            report["snr_db"]["without_residual"],
            size=size["weights"] + size["dictionary"],
            lobes=lobes,
            note="the same fit without its residual",
        ),
    ]


def _search(problem: Problem) -> Row:
    config = shipped(DEFAULT, problem.scope.overrides)
    texels = problem.some_texels(problem.scope.search_texels)
    own = torch.arange(len(texels))  # one cluster for each texel, to tell their lobes apart

    fit = FitProblem.build(problem.btf, UNIFORM, config, Context.build(str(problem.device)))

    @torch.no_grad()
    def work() -> FoundLobes:
        generator = torch.Generator().manual_seed(config.seed)
        return find_lobes(fit, Samples(texels, own), generator, lambda _: None)

    found, timing = measure(work, problem.protocol, problem.device)
    fraction = torch.ones(len(texels), dtype=torch.float64)  # of the energy left; 1 without lobes
    fraction[found.cluster] = found.error.double()
    energy = problem.btf.texels(texels).square().sum((1, 2), dtype=torch.float64)
    snr = snr_db(float(energy.sum()), float((fraction * energy).sum()))
    lobes = len(found.lobes) / len(texels)
    each = problem.ours.stages["search"] / len(problem.ours.result.info["samples"])
    note = f"few texels do not fill a batch: in the default fit a sample takes {each:.3f} s"
    return row("spmm search", SEARCH, len(texels), timing, snr, lobes=lobes, note=note)


def _selection(problem: Problem) -> Row:
    config, atoms = shipped(DEFAULT, problem.scope.overrides), problem.atoms
    values = problem.values[problem.some_texels(problem.scope.dictionary_texels)]
    signals = values.transpose(1, 2).contiguous()  # [n, C, D]
    count, channels, _ = signals.shape

    @torch.no_grad()
    def work() -> tuple[Products, Fit]:
        whole = [slice(0, count)]
        products = cluster_products(lambda part: signals[part], whole, (count, channels), atoms)
        target = target_beside_residual(products, None, 0.0)
        return products, select(products, target, config.select, config.stagewise)

    (products, fit), timing = measure(work, problem.protocol, problem.device)
    error = float(squared_errors(products, fit).sum())
    lobes = float((fit.index >= 0).sum(1).double().mean())
    snr = snr_db(float(products.energy.sum()), error)
    return row("spmm select", SELECTION, count, timing, snr, lobes=lobes)


PEER = Peer("spmm", "this program with default settings", run)
