"""The findings about a BTF, one sentence each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import torch

from ..data import BTF
from ..data.units import ORDINARY
from .drift import Drift, drift
from .energy import reflectance
from .peaks import Peaks, peaks
from .reciprocity import DOUBLED, ENCODED, NONE, Exchange, exchange
from .sums import Sums

# From here on a finding is worth a look: shares of all values, a ratio, a reflectance, texels.
CLIPPED_SHARE, BLACK_SHARE, MISSING_SHARE = 1e-3, 0.2, 0.0
ASYMMETRY, FULL, DRIFTED = 0.25, 1.05, 0.75


@dataclass(frozen=True)
class Finding:
    """What one check has found.

    Attributes:
        name: of the check.
        fine: whether it is as a fit expects; None: it cannot be told.
        says: one sentence.
        figures: the numbers behind it.
    """

    name: str
    fine: bool | None
    says: str
    figures: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """The finding as JSON has it."""
        verdict = {True: "fine", False: "look", None: "unknown"}[self.fine]
        return {"verdict": verdict, "says": self.says, **self.figures}


def check_btf(btf: BTF, progress: Callable[[int], object] = lambda count: None) -> list[Finding]:
    """Everything that is checked about a BTF, by one pass over its views.

    Args:
        btf: the BTF, best decoded; missing pairs may be masked.
        progress: called with the number of views just done.

    Raises:
        DataError: a value is not valid.
    """
    return list(findings(btf, Sums.of(btf, progress)))


def findings(btf: BTF, sums: Sums) -> Iterator[Finding]:
    """The findings of a BTF, given the figures of its values."""
    grey = sums.mean.mean(-1)  # [V, L]
    measured = torch.ones(grey.shape) if btf.missing is None else (~btf.missing).double()
    swapped = exchange(grey, btf.light, btf.view)
    yield _values(sums)
    yield _missing(btf)
    yield _cosine(swapped)
    yield _gamma(swapped)
    yield _reciprocity(swapped)
    yield _energy(float(reflectance(sums.mean, btf.light, measured).max()))
    yield _clipped(sums)
    yield _hot(btf, sums)
    yield _sampling(peaks(sums.kept, btf.light, btf.view))
    yield _registration(drift(sums.pictures, btf.view))


def _values(sums: Sums) -> Finding:
    low, high = ORDINARY
    black = sums.zeros / sums.count
    says = f"values from {sums.lowest:.4g} to {sums.highest:.4g}, {black:.1%} of them 0 or below"
    fine = low <= sums.highest <= high and black <= BLACK_SHARE
    if not fine:
        says += "; check exposure, unit and conversion"
    figures = {"lowest": sums.lowest, "highest": sums.highest, "black_share": black}
    return Finding("values", fine, says, figures)


def _missing(btf: BTF) -> Finding:
    gone = btf.pair_count - btf.measured_count
    if gone == 0:
        return Finding("pairs", True, f"all {btf.pair_count} pairs have a picture", {"missing": 0})
    says = f"{gone} of {btf.pair_count} pairs have no picture; fit with --set data.missing=mask"
    return Finding("pairs", False, says, {"missing": gone})


def _cosine(found: Exchange) -> Finding:
    figures = {"slope": found.slope, "exchanged_pairs": found.pairs}
    if found.slope is None:
        says = "too few directions are both light and view to tell whether values hold the cosine"
        return Finding("cosine", None, says, figures)
    says = f"exchanged directions differ by the cosine to the power {found.slope:.2f}"
    if found.slope < NONE:
        says += "; values seem to lack the cosine: fit with --set data.cosine=missing"
        return Finding("cosine", False, says, figures)
    if found.slope > DOUBLED:
        says += "; values seem to hold it twice, or to be decoded twice: see gamma"
        return Finding("cosine", False, says, figures)
    return Finding("cosine", True, f"{says}: values hold it", figures)


def _gamma(found: Exchange) -> Finding:
    if found.slope is None or found.slope < NONE:
        says = "without the cosine in the values nothing tells whether they are linear"
        return Finding("gamma", None, says, {"gamma": None})
    figures = {"gamma": 1.0 / found.slope}
    if found.slope < ENCODED:
        says = f"values seem to be encoded for a display still, by about {1.0 / found.slope:.1f}"
        return Finding("gamma", False, f"{says}: fit with a larger data.gamma", figures)
    if found.slope > DOUBLED:
        says = "values seem to be linear codes that were decoded: fit with --set data.gamma=1.0"
        return Finding("gamma", False, says, figures)
    return Finding("gamma", True, "values seem to be linear", figures)


def _reciprocity(found: Exchange) -> Finding:
    figures = {"asymmetry": found.asymmetry}
    if found.asymmetry is None:
        return Finding("reciprocity", None, "too few directions are both light and view", figures)
    says = f"exchanged directions differ by {found.asymmetry:.0%} otherwise"
    fine = found.asymmetry <= ASYMMETRY
    if not fine:
        says += "; check the order of lights and views, and the calibration"
    return Finding("reciprocity", fine, says, figures)


def _energy(most: float) -> Finding:
    says = f"even light is reflected by {most:.0%} at most"
    fine = most <= FULL
    if not fine:
        says += "; more than all of it: check the unit, the white reference and the cosine"
    return Finding("energy", fine, says, {"highest_reflectance": most})


def _clipped(sums: Sums) -> Finding:
    share = sums.at_highest / sums.count
    says = f"{share:.2%} of the values are the highest"
    fine = share <= CLIPPED_SHARE or sums.lowest == sums.highest
    if not fine:
        says += "; highlights seem to be clipped: expose shorter, or expect dull ones"
    return Finding("clipping", fine, says, {"share_at_highest": share})


def _hot(btf: BTF, sums: Sums) -> Finding:
    if not sums.hot:
        return Finding("hot pixels", True, "no pixel stands far above its picture", {"hot": 0})
    view, light, texel = sums.hot[0]
    row, column = divmod(texel, btf.width)
    says = (
        f"{len(sums.hot)} pixels stand far above their picture, the first at view {view}, light "
        f"{light}, row {row}, column {column}; mend them"
    )
    return Finding("hot pixels", False, says, {"hot": len(sums.hot)})


def _sampling(found: Peaks) -> Finding:
    spacing = math.degrees(found.spacing)
    figures = {"spacing_degrees": spacing, "half_width_degrees": None, "share": found.share}
    if found.half_width is None:
        return Finding(
            "sampling", True, f"no sharp peaks; lights are {spacing:.1f}° apart", figures
        )
    width = math.degrees(found.half_width)
    says = f"peaks have fallen by half after {width:.1f}°, lights are {spacing:.1f}° apart"
    fine = width >= spacing
    if not fine:
        says += "; peaks are narrower than their sampling: their shape is a guess"
    return Finding("sampling", fine, says, figures | {"half_width_degrees": width})


def _registration(found: Drift) -> Finding:
    figures = {"drift_texels": found.rest, "plane_texels": found.slope, "views": found.views}
    if found.rest is None:
        return Finding("registration", None, "too little texture to compare views", figures)
    says = (
        f"{found.views} views lie within {found.rest:.1f} texels of the frontal one, on a plane "
        f"{abs(found.slope):.1f} texels {'above' if found.slope < 0 else 'below'} the texture"
    )
    fine = found.rest <= DRIFTED
    if not fine:
        says += (
            "; views drift, or the surface is no plane: keep relief.mode and relief.drift at auto"
        )
    return Finding("registration", fine, says, figures)
