"""The stages of a fit, each with its own randomness, its time and its ranks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF
from ..data.error_weights import Weights
from ..lobes.grid import DirectionGrid
from ..runtime.checkpoint import stage_generator
from ..runtime.progress import Stage
from ..runtime.ranks import Ranks
from ..runtime.stopwatch import Stopwatch
from .cluster import Clusters, cluster_texels
from .dictionary import Dictionary, FoundLobes
from .prune.ablation import worth_of_models
from .prune.auto import Choice, choose
from .search.lobes import search_lobes


@dataclass(frozen=True)
class Steps:
    """What the stages of one fit share.

    Attributes:
        btf: the values.
        config: of the fit.
        weights: of texels and pairs.
        device: on which to work.
        watch: tells the time by stage.
        ranks: that share the fit; all of them call every stage.
    """

    btf: BTF
    config: FitConfig
    weights: Weights
    device: torch.device
    watch: Stopwatch
    ranks: Ranks

    def cluster(self, stage: Stage) -> Clusters:
        """k-means over all texels [WDR11 §4.1]."""
        with self.watch("cluster"):
            return cluster_texels(
                self.btf,
                self.config.cluster,
                self._generator("cluster"),
                self.device,
                stage,
                self.ranks,
                self.weights,
            )

    def choose(self, samples: Tensor, stage: Stage) -> Choice:
        """Models and lobes that pay for their bytes, by some of `samples [S]`."""
        generator = self._generator("auto")
        with self.watch("search"):
            return self.ranks.first(
                lambda: choose(
                    self.btf, samples, self.config, self.weights, self.device, generator, stage
                )
            )

    def search(
        self, samples: Tensor, owners: Tensor, grid: DirectionGrid, stage: Stage
    ) -> FoundLobes:
        """Lobes of `samples [S]` of clusters `owners [S]` [WDR11 §3.2]."""
        generator = self._generator("search")
        with self.watch("search"):
            return self.ranks.first(
                lambda: search_lobes(
                    self.btf, samples, owners, grid, self.config, generator, stage, self.weights
                ).on_cpu()
            )

    def worth(self, clusters: Clusters, dictionary: Dictionary) -> dict[str, Any]:
        """What every model buys."""
        generator = self._generator("worth")
        with self.watch("evaluate"):
            return self.ranks.first(
                lambda: worth_of_models(
                    self.btf, clusters.labels, dictionary, self.config, self.weights, generator
                )
            )

    def _generator(self, stage: str) -> torch.Generator:
        return stage_generator(self.config.seed, stage)
