"""Edits as they stand in a script: one dataclass each, whose fields are its options.

Every field carries its meaning, range and default, so that sliders can be made of them. Angles are
degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from ..brdf import MODEL_NAMES
from ..config.schema import REQUIRED, setting
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM
from .colour import MAX_SATURATION
from .groups import GROUPS
from .mixing import blend, copy_look
from .normals import rotate_tangent, spread_normals
from .parameters import replace_model, set_parameter
from .recolour import FITS, hue_saturation
from .regions import Rectangle
from .residual import residual_strength
from .selection import Selection
from .weights import intensity
from .widths import scale_width

# Ranges that sliders span; functions take more.
MAX_FACTOR = 100.0
THRESHOLD = "width in rad under which lobes are specular"


class Edit(Protocol):
    """One edit with its options."""

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        ...


@dataclass(frozen=True)
class Intensity:
    """Brighter or darker."""

    factor: float = setting(1.0, "what weights are multiplied by", low=0.0, high=MAX_FACTOR)
    group: str = setting("all", "which lobes", choices=GROUPS)
    threshold: float = setting(SPECULAR_WIDTH, THRESHOLD, low=0.0)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return intensity(model, self.factor, where, self.group, self.threshold)


@dataclass(frozen=True)
class HueSaturation:
    """Another hue, more or less colour."""

    hue: float = setting(0.0, "turn in degrees, from red towards green", low=-360.0, high=360.0)
    saturation: float = setting(1.0, "factor on the saturation", low=0.0, high=MAX_SATURATION)
    group: str = setting("all", "which lobes", choices=GROUPS)
    threshold: float = setting(SPECULAR_WIDTH, THRESHOLD, low=0.0)
    fit: str = setting("material", "colours that M is fitted to; unit: paper", choices=FITS)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        turn = math.radians(self.hue)
        return hue_saturation(
            model, turn, self.saturation, where, self.group, self.threshold, self.fit
        )


@dataclass(frozen=True)
class ScaleWidth:
    """Narrower lobes (more metallic) or wider ones."""

    factor: float = setting(1.0, "what widths are multiplied by", low=0.01, high=MAX_FACTOR)
    group: str = setting("specular", "which lobes", choices=GROUPS)
    threshold: float = setting(SPECULAR_WIDTH, THRESHOLD, low=0.0)
    keep_energy: bool = setting(False, "whether lobes go on to reflect as much as before")

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return scale_width(model, self.factor, where, self.group, self.threshold, self.keep_energy)


@dataclass(frozen=True)
class SpreadNormals:
    """Rougher, more embossed; or smoother."""

    factor: float = setting(
        1.0, "what tilts of normals are multiplied by", low=0.0, high=MAX_FACTOR
    )
    group: str = setting("all", "which lobes", choices=GROUPS)
    threshold: float = setting(SPECULAR_WIDTH, THRESHOLD, low=0.0)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return spread_normals(model, self.factor, where, self.group, self.threshold)


@dataclass(frozen=True)
class RotateTangent:
    """Anisotropic highlights turned."""

    angle: float = setting(0.0, "turn in degrees, counter-clockwise", low=-360.0, high=360.0)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return rotate_tangent(model, math.radians(self.angle), where)


@dataclass(frozen=True)
class ResidualStrength:
    """The residual stronger, weaker, or off."""

    factor: float = setting(1.0, "what the residual is multiplied by", low=0.0, high=MAX_FACTOR)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return residual_strength(model, self.factor, where)


@dataclass(frozen=True)
class SetParameter:
    """A parameter of lobes set to a value."""

    name: str = setting(REQUIRED, "the name of a parameter of a BRDF, such as exponent")
    value: float = setting(REQUIRED, "its value, in its own unit")

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return set_parameter(model, self.name, self.value, where)


@dataclass(frozen=True)
class ReplaceModel:
    """Another BRDF of the same width and energy."""

    name: str = setting(REQUIRED, "the name of a BRDF", choices=MODEL_NAMES)
    group: str = setting("all", "which lobes", choices=GROUPS)
    threshold: float = setting(SPECULAR_WIDTH, THRESHOLD, low=0.0)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        return replace_model(model, self.name, where, self.group, self.threshold)


@dataclass(frozen=True)
class Blend:
    """Mixed with another model of the same size."""

    path: str = setting(REQUIRED, "a run folder or model file; relative to the script")
    amount: float = setting(0.5, "share of the other model", low=0.0, high=1.0)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        other = SPMM.load(self.path, model.weight.device)
        return blend(model, other, self.amount, where)


@dataclass(frozen=True)
class CopyLook:
    """The look of a rectangle, repeated over the mask."""

    x: int = setting(REQUIRED, "the leftmost column to copy from", low=0)
    y: int = setting(REQUIRED, "the topmost row to copy from", low=0)
    width: int = setting(REQUIRED, "number of columns", low=1)
    height: int = setting(REQUIRED, "number of rows", low=1)

    def apply(self, model: SPMM, where: Selection | None) -> SPMM:
        """The edited model."""
        source = Rectangle(self.x, self.y, self.width, self.height)
        return copy_look(model, source, where)


EDITS: dict[str, type] = {
    "intensity": Intensity,
    "hue_saturation": HueSaturation,
    "scale_width": ScaleWidth,
    "spread_normals": SpreadNormals,
    "rotate_tangent": RotateTangent,
    "set_parameter": SetParameter,
    "replace_model": ReplaceModel,
    "residual_strength": ResidualStrength,
    "blend": Blend,
    "copy_look": CopyLook,
}
