"""What a fit minimizes: squared errors, or others where data are glossy.

Squared errors of glossy data see the peaks at grazing angles alone. Where directions resolve the
peaks, a trial tells whether errors count as they are or relative to their view; or whether those of
cube roots count beside them, since a body would not be worth a lobe else. Where directions do not,
values at the peaks say little, and errors of cube roots count alone.

Peaks that the directions do not resolve are over-represented: directions are measured as mirror
images of each other, so that as many pairs meet such a peak as if it were as wide as the angle
between directions. Errors there count by the share of that solid angle which the peak has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...brdf import PAPER_MODELS
from ...config.fit import FitConfig
from ...data import BTF
from ...lobes.grid import DirectionGrid
from ...lobes.sampling import specular_mask
from ...model.spmm import SPMM
from ...report.contract import ObjectiveFigures
from .measure import ENERGY, PAIRS, is_glossy, some_texels
from .peaks import NARROW, Unresolved, peak_pairs, unresolved
from .trial import best_error
from .views import BY_VIEW

# The model whose peaks have tails as those of measured glossy materials, which the seven lack.
LONG_TAILED = "ggx"


@dataclass(frozen=True)
class Objective:
    """What a fit minimizes.

    Attributes:
        error: l2, by-view, balanced, cube-root or log.
        chosen: whether the data chose it, and not the settings.
        resolved: width of the narrowest lobes that the directions resolve, as a slope.
        peak: the narrowest peaks, which the directions do not resolve; None: all are resolved.
        pair: factors of the weights of pairs, `[D]`; None: 1.
    """

    error: str = "l2"
    chosen: bool = False
    resolved: float = 0.0
    peak: Unresolved | None = None
    pair: Tensor | None = None

    @classmethod
    def of(
        cls, btf: BTF, config: FitConfig, device: torch.device, suited: str | None = None
    ) -> Objective:
        """The objective of a fit, by the settings and some of the texels.

        Args:
            btf: decoded.
            config: of the fit.
            device: of the computation.
            suited: errors that suit glossy texels whose peaks are resolved; None: a trial tells.
        """
        error, chosen = config.weights.error, config.weights.error == "auto"
        if error == "l2" or (chosen and config.search.method == "stagewise"):
            return cls()
        values = btf.signals(some_texels(btf.texel_count), device)  # [n, C, D]
        values = values[values.flatten(1).any(1)]  # black texels have no peaks, and suit any error
        if chosen and not is_glossy(values):
            return cls(chosen=True)
        grid = DirectionGrid.build(btf.light, btf.view, device)
        width = config.search.min_width * grid.spacing
        peak = unresolved(grid, values, width)
        upright = unresolved(grid, values.mean(0, keepdim=True), width)
        pair = None
        if upright is not None:
            share = (upright.width / width) ** 2
            pair = torch.where(peak_pairs(grid, width), share, 1.0).cpu()
        if chosen and peak is None:
            error = suited or best_error(grid, values, config.search)
        elif chosen:
            error = "cube-root"
        return cls(error, chosen, width, peak, pair)

    @classmethod
    def of_lists(cls, config: FitConfig) -> Objective:
        """The objective of scattered samples, which tell by their own density nothing of gloss.

        Directions of a list resolve what they see.
        """
        error, chosen = config.weights.error, config.weights.error == "auto"
        if error == "l2" or (chosen and config.search.method == "stagewise"):
            return cls()
        return cls("balanced" if chosen else error, chosen)

    @property
    def plain(self) -> bool:
        """Whether squared errors of all values count alike."""
        return self.error == "l2"

    @property
    def unresolved(self) -> bool:
        """Whether some peaks are narrower than the directions."""
        return self.peak is not None

    def describe(self) -> str | None:
        """What the data chose, in one line; None where that is the plain squared error."""
        if not self.chosen or self.plain:
            return None
        line = (
            f"glossy: {ENERGY:.0%} of the energy lies in under {PAIRS:.0%} of the direction pairs"
        )
        if self.error == BY_VIEW:
            return f"{line}; errors count relative to their view"
        if self.peak is None:
            return f"{line}; errors of values and of cube roots count"
        kind = "metal" if self.peak.metal else "dielectric"
        return (
            f"{line}; errors of cube roots count; peaks narrower than the directions, held to what "
            f"a {kind} reflects (width {math.degrees(self.peak.width):.2g} degrees)"
        )

    def figures(self, model: SPMM) -> ObjectiveFigures:
        """What the report says of the objective, and of the lobes of a model that are a guess."""
        by = "data" if self.chosen else "settings"
        if self.peak is None:
            return ObjectiveFigures(self.error, by, 0, 0.0)
        lobes = model.dictionary.detach()
        limit = NARROW * self.resolved
        count = int(specular_mask(lobes, limit).sum())
        return ObjectiveFigures(self.error, by, count, model.narrow_share(limit))

    def models(self, names: tuple[str, ...], each: bool = False) -> tuple[str, ...]:
        """Models of the lobes: GGX joins the paper's for unresolved peaks, and where it pays.

        That is where the data chose squared errors, and `each` texel is searched: felts and paints
        fade towards the horizon as none of the seven.
        """
        joins = self.unresolved or (each and self.chosen and self.plain)
        return most_models(names) if joins else names


PLAIN = Objective()


def most_models(names: tuple[str, ...]) -> tuple[str, ...]:
    """Models that lobes may have where the settings say `names`: GGX may join the paper's."""
    return (*names, LONG_TAILED) if names == PAPER_MODELS else names
