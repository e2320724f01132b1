"""The sliders of the editor, and the edits that their values stand for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

from ...edit import Edit, Mask, Step
from ...edit.edits.hue_saturation import HueSaturation
from ...edit.edits.intensity import Intensity
from ...edit.edits.relief_depth import ReliefDepth
from ...edit.edits.residual_strength import ResidualStrength
from ...edit.edits.rotate_tangent import RotateTangent
from ...edit.edits.scale_width import ScaleWidth
from ...edit.edits.spread_normals import SpreadNormals

SPECULAR, NON_SPECULAR = "specular", "non_specular"
# The name of the slider that needs a relief.
RELIEF = "relief"


@dataclass(frozen=True)
class Slider:
    """One slider.

    Attributes:
        name: its key.
        title: the text beside it.
        low, high, step: its range.
        neutral: where it changes nothing.
        unit: written after its value.
        group: the lobes that it changes; None for all.
    """

    name: str
    title: str
    low: float
    high: float
    step: float
    neutral: float
    unit: str = ""
    group: str | None = None


SLIDERS: tuple[Slider, ...] = (
    Slider("intensity", "Intensity", 0.0, 3.0, 0.01, 1.0, "×"),
    Slider("hue", "Hue", -180.0, 180.0, 1.0, 0.0, "°"),
    Slider("saturation", "Saturation", 0.0, 2.0, 0.01, 1.0, "×"),
    Slider("specular", "Specular intensity", 0.0, 6.0, 0.01, 1.0, "×", SPECULAR),
    Slider("specular_hue", "Specular hue", -180.0, 180.0, 1.0, 0.0, "°", SPECULAR),
    Slider("diffuse", "Non-specular intensity", 0.0, 3.0, 0.01, 1.0, "×", NON_SPECULAR),
    Slider("width", "Lobe width", 0.1, 2.0, 0.01, 1.0, "×", SPECULAR),
    Slider("normals", "Spread of normals", 0.0, 3.0, 0.01, 1.0, "×"),
    Slider("tangent", "Turn of anisotropy", -90.0, 90.0, 1.0, 0.0, "°"),
    Slider("residual", "Residual", 0.0, 2.0, 0.01, 1.0, "×"),
    Slider(RELIEF, "Relief depth", 0.0, 3.0, 0.01, 1.0, "×"),
)
BY_NAME = {slider.name: slider for slider in SLIDERS}
NEUTRAL: dict[str, float] = {slider.name: slider.neutral for slider in SLIDERS}


# The sliders of each edit of `_all_edits`, in the order of its options.
SLIDERS_OF_EDITS = (
    ("normals",),
    ("tangent",),
    ("width",),
    (RELIEF,),
    ("residual",),
    ("intensity",),
    ("specular",),
    ("diffuse",),
    ("hue", "saturation"),
    ("specular_hue",),
)


def edits_of(values: Mapping[str, float]) -> list[Edit]:
    """The edits that sliders stand for, in a fixed order; those that change nothing are left out.

    Args:
        values: of sliders by name; missing ones are neutral.
    """
    pairs = zip(_all_edits(NEUTRAL | dict(values)), _all_edits(NEUTRAL), strict=True)
    return [edit for edit, unchanged in pairs if edit != unchanged]


def _all_edits(values: Mapping[str, float]) -> tuple[Edit, ...]:
    """All edits: lobes before weights, so that the sliders moved most cost least."""
    return (
        SpreadNormals(values["normals"]),
        RotateTangent(values["tangent"]),
        ScaleWidth(values["width"]),
        ReliefDepth(values[RELIEF]),
        ResidualStrength(values["residual"]),
        Intensity(values["intensity"]),
        Intensity(values["specular"], group=SPECULAR),
        Intensity(values["diffuse"], group=NON_SPECULAR),
        HueSaturation(values["hue"], values["saturation"]),
        HueSaturation(values["specular_hue"], group=SPECULAR),
    )


def values_of(edits: Sequence[Edit]) -> dict[str, float] | None:
    """The values of the sliders that stand for these edits, in this order; None if none do."""
    values: dict[str, float] = {}
    for edit in edits:
        for names, neutral in zip(SLIDERS_OF_EDITS, _all_edits(NEUTRAL), strict=True):
            if type(edit) is type(neutral) and _group(edit) == _group(neutral):
                options = (getattr(edit, each.name) for each in fields(cast(Any, edit)))
                values |= dict(zip(names, options, strict=False))
    allowed = all(BY_NAME[name].low <= x <= BY_NAME[name].high for name, x in values.items())
    return values if allowed and edits_of(values) == list(edits) else None


def _group(edit: Edit) -> str | None:
    """The lobes that an edit changes; None for those that have no such option."""
    return getattr(edit, "group", None)


def steps_of(values: Mapping[str, float], mask: Mask | None) -> tuple[Step, ...]:
    """The steps of a script that sliders stand for, all under one mask."""
    return tuple(Step(edit, mask) for edit in edits_of(values))
