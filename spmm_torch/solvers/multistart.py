"""Several starts of the same problems: which one is best, and how many failed."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor


def best_start(value: Tensor) -> Tensor:
    """Which of R starts has the least value, for each of S problems: `value [R, S]` to `[S]`.

    NaN, which `argmin` would take for the least of all, counts as the worst.
    """
    return torch.where(value.isnan(), torch.inf, value).argmin(0)


@dataclass
class StartTally:
    """How the starts of optimizers ended.

    Attributes:
        starts: how many there were.
        not_finite: of them, those whose value was NaN or infinite.
        no_descent: of them, those from which no step, however short, went down.
    """

    starts: int = 0
    # Tensors, so that counting does not wait for the device.
    not_finite: Tensor = field(default_factory=lambda: torch.zeros((), dtype=torch.long))
    no_descent: Tensor = field(default_factory=lambda: torch.zeros((), dtype=torch.long))

    def add(self, failed: Tensor, stuck: Tensor) -> None:
        """Counts starts of which some failed, both `[R]` bool: NaN or infinite, and stuck."""
        self.starts += len(failed)
        self.not_finite = self.not_finite.to(failed.device) + failed.sum()
        self.no_descent = self.no_descent.to(stuck.device) + (stuck & ~failed).sum()

    def to_tensor(self) -> Tensor:
        """All three counts in their order, `[3]` on the CPU."""
        return torch.tensor([self.starts, int(self.not_finite), int(self.no_descent)])
