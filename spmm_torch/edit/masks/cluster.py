"""The texels of clusters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...model.spmm import SPMM
from ..selection import Selection, select_texels


@dataclass(frozen=True)
class ClusterMask:
    """The texels of clusters."""

    number: tuple[int, ...] = setting(REQUIRED, "the number of a cluster, or a list", low=0)

    def select(self, model: SPMM) -> Selection:
        """Their texels in a model."""
        return cluster_selection(model, self.number)


def cluster_selection(model: SPMM, clusters: Sequence[int]) -> Selection:
    """The texels of some clusters, by their numbers.

    Raises:
        ConfigError: no such cluster.
    """
    for cluster in clusters:
        if not 0 <= cluster < model.cluster_count:
            raise ConfigError(
                f"cluster {cluster} does not exist; expected 0 to {model.cluster_count - 1}."
            )
    wanted = torch.tensor(list(clusters), device=model.labels.device)
    return select_texels(model, torch.isin(model.labels, wanted))
