"""What a search for a relief works on, and the registration of its views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...data import BTF
from ...geometry.directions import REPEAT
from .border import border_rule
from .drift import SIGNIFICANCE, find_drift
from .pictures import PictureStack, chosen_lights, chosen_views, read_stack
from .sweep import swept_once
from .verdict import disagreement, drift_pays, heights_pay, plane_pays

# Lights under which heights are sought, and others under which they are judged.
SOUGHT, JUDGED = 5, 2
# Texels of a side in which it is found what chance would give.
CHANCE_SIDE = 96


@dataclass(frozen=True)
class Search:
    """Pictures to seek a relief in, and others to judge it by.

    Attributes:
        btf: the BTF.
        views: indices `[V']` of the views that take part.
        lights: indices `[L']` of the lights to seek under.
        sought, judged: pictures to seek in and to judge by, of the same views.
        untouched: disagreement of the pictures to judge by as they are.
    """

    btf: BTF
    views: Tensor
    lights: Tensor
    sought: PictureStack
    judged: PictureStack
    untouched: float

    @classmethod
    def open(cls, btf: BTF, device: torch.device | str) -> Search:
        """Decodes the pictures of a search, and no others.

        Raises:
            DataError, OutputError: as for `read_stack`.
        """
        views, lights = chosen_views(btf), chosen_lights(btf, SOUGHT + JUDGED)
        stack = read_stack(btf, views, lights, device)
        stack = replace(stack, repeats=border_rule(stack) == REPEAT)
        count = len(lights)
        apart = min(JUDGED, count // 2)
        kept = torch.arange(count - apart)
        # A single light must both tell and judge.
        other = torch.arange(count - apart, count) if apart else kept
        judged = stack.part(lights=other)
        flat = torch.zeros(stack.size, device=stack.values.device)
        untouched = disagreement(judged, flat)
        return cls(btf, views, lights[kept], stack.part(lights=kept), judged, untouched)

    def flat(self, height: float) -> Tensor:
        """A plane of some height as a map `[H, W]`."""
        return torch.full(self.sought.size, height, device=self.sought.values.device)

    def left(self, height: Tensor) -> float:
        """Fraction of the views' disagreement that is left with `height [H, W]`."""
        return disagreement(self.judged, height) / max(self.untouched, 1e-12)

    def plane_pays(self, height: float) -> bool:
        """Whether a plane of some height pays against none."""
        return plane_pays(self.judged, self.flat(height), self.untouched)

    def heights_pay(self, height: Tensor, base: Tensor) -> bool:
        """Whether a map `height [H, W]` pays against `base [H, W]`."""
        return heights_pay(self.judged, height, base, self.untouched, self._left_by_chance)

    def _left_by_chance(self) -> float:
        """Fraction of the disagreement that is left by heights found in views turned by a quarter.

        The middle of the pictures tells it.
        """
        sought, judged = (part.middle(CHANCE_SIDE).turned() for part in (self.sought, self.judged))
        height = swept_once(sought)
        untouched = disagreement(judged, torch.zeros_like(height))
        return disagreement(judged, height) / max(untouched, 1e-12)

    def drifted(self, drift: Tensor) -> Search:
        """The search in views that drift by `[V', 2]` columns and rows."""
        return replace(
            self,
            sought=replace(self.sought, drift=drift),
            judged=replace(self.judged, drift=drift),
        )

    def registered(self, height: Tensor) -> tuple[Search, float]:
        """The search with the drift of its views over points of `height [H, W]`.

        Returns:
            (the search, the height to be added to all heights); the search itself and 0 where
            there is no drift beyond what it has.
        """
        found = find_drift(self.sought, height)
        total = self.sought.drift + found.shift
        if found.is_noise(total):
            return self.drifted(torch.zeros_like(total)), 0.0
        if not drift_pays(self.judged, total, height + found.plane, self.untouched):
            return self, 0.0
        return self.drifted(total), found.plane

    def drift_of_all_views(self, height: Tensor) -> Tensor | None:
        """The drift of every view of the BTF, `[V, 2]` in units of u and v; None: none.

        Views that do not take part are registered too where the drift exceeds its error.
        """
        known = self.sought.drift
        if not bool(known.any()):
            return None
        count = len(self.btf.view)
        drift = torch.zeros(count, 2, device=known.device)
        drift[self.views] = known
        steep = torch.zeros(count, dtype=torch.bool)
        steep[self.views] = True
        if not bool(steep.all()):
            drift = self._completed(drift, steep, height)
        rows, columns = self.sought.size
        return (drift / torch.tensor([columns, -rows], device=drift.device)).cpu()

    def _completed(self, drift: Tensor, steep: Tensor, height: Tensor) -> Tensor:
        """The `drift [V, 2]` with that of the views that are not `steep [V]`, in texels."""
        stack = read_stack(self.btf, torch.arange(len(steep)), self.lights, drift.device)
        stack = replace(stack, drift=drift, repeats=self.sought.repeats)
        found = find_drift(stack, height, steep)
        clear = found.shift.norm(dim=1) > SIGNIFICANCE * found.error
        return torch.where((clear & ~steep)[:, None], found.shift, drift)
