"""Lobes of scattered samples: those of some texels, each found on its own list of pairs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.fit import FitConfig
from ...data.pair_lists import PairedBTF, PairList
from ...data.scattered_btf import ScatteredBTF
from ...lobes.batch import LobeBatch
from ...lobes.grid import DirectionGrid
from ...runtime.context import Context
from ...runtime.progress import Advance
from ...solvers.status import StatusCounts
from ..cluster import Samples, cluster_texels, sample_texels
from ..dictionary import FoundLobes, merge_lobes
from ..glossy.objective import Objective
from ..problem import Problem
from ..search.lobes import find_lobes, search_steps
from .thinned import thinned
from .weights import list_weights

# Pairs of a list on which lobes are sought, at most: so many as a dense grid has.
SOUGHT_PAIRS = 1 << 14
# Lists shorter than this part of the longest are not searched: few samples tell which of the lobes
# found elsewhere they show, and no lobes of their own.
LEAST_SHARE = 0.1
# Pairs, of all lists together, on which lobes are compared: two of one shape are one.
COMPARED_PAIRS = 1 << 12


@dataclass(frozen=True)
class Task:
    """The search of one list.

    Attributes:
        pairs: the list, or those of its pairs that stand for it.
        problem: of its texels.
        samples: those of them that are searched.
    """

    pairs: PairList
    problem: Problem
    samples: Samples


def search_tasks(
    btf: ScatteredBTF, config: FitConfig, context: Context, objective: Objective
) -> list[Task]:
    """The searches that a fit makes: where there are several lists, they are the clusters."""
    generator, lists = context.generator("lists"), btf.lists
    if len(lists) == 1:
        pairs, problem = _problem(lists[0], config, context, objective, generator)
        clusters = cluster_texels(problem)
        return [Task(pairs, problem, sample_texels(problem, clusters))]
    longest = max(len(part.wi) for part in lists)
    long = [part for part in lists if len(part.wi) >= LEAST_SHARE * longest]
    chosen = torch.randperm(len(long), generator=generator)[: config.cluster.count].sort().values
    tasks = []
    for part in (long[index] for index in chosen.tolist()):
        order = torch.randperm(len(part.texels), generator=generator)
        some = order[: config.sample.per_cluster].sort().values
        pairs, problem = _problem(part, config, context, objective, generator)
        tasks.append(Task(pairs, problem, Samples(some, torch.zeros_like(some))))
    return tasks


def _problem(
    part: PairList,
    config: FitConfig,
    context: Context,
    objective: Objective,
    generator: torch.Generator,
) -> tuple[PairList, Problem]:
    """The pairs of a list that are searched, and the problem of its texels there."""
    pairs, chance = thinned(part, SOUGHT_PAIRS, generator)
    own = PairedBTF.of(pairs)
    weights = list_weights(own, objective, context.device, chance)
    return pairs, Problem.build(own, weights, config, context, objective)


def found_lobes(tasks: list[Task], context: Context) -> FoundLobes:
    """The lobes of all lists."""
    generator = context.generator("search")

    def search(advance: Advance) -> FoundLobes:
        found = [find_lobes(one.problem, one.samples, generator, advance) for one in tasks]
        parts = [each.on_cpu() for each in found]
        return FoundLobes(
            LobeBatch.cat([part.lobes for part in parts]),
            torch.zeros_like(torch.cat([part.cluster for part in parts])),
            torch.cat([part.error for part in parts]),
            torch.stack([part.starts for part in parts]).sum(0),
            StatusCounts.sum(part.solvers for part in parts),
        )

    steps = sum(search_steps(one.problem.config, len(one.samples)) for one in tasks)
    return context.stage("search", FoundLobes, search, steps, "steps")


def distinct_lobes(found: FoundLobes, tasks: list[Task], context: Context) -> LobeBatch:
    """The lobes found without repeats, the better ones first, compared at pairs of all lists."""
    with context.watch("dictionary"):
        wi, wo = (torch.cat(side) for side in zip(*_compared(tasks, context), strict=True))
        grid = DirectionGrid.of_pairs(wi, wo, context.device)
        return merge_lobes(found, 1, grid, tasks[0].problem.config.dictionary).lobes


def _compared(tasks: list[Task], context: Context) -> Iterator[tuple[Tensor, Tensor]]:
    """Lights and views of some pairs of each list."""
    generator = context.generator("compared")
    each = max(1, COMPARED_PAIRS // len(tasks))
    for task in tasks:
        some, _ = thinned(task.pairs, each, generator)
        yield some.wi, some.wo
