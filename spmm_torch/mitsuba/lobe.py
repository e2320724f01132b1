"""The lobes of a model in the arrays of a variant: one of them, its value, samples and density."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..brdf import MAX_PARAMETERS
from ..lobes.sampling import LOWEST_Z
from .arrays import branch, one, row
from .brdf import Twin
from .brdf.base import COS_EPS
from .libraries import dr, mi

# Numbers of a lobe: sine and cosine of its angle, its normal, and its parameters.
TURN, NORMAL, KAPPA = 0, 2, 5
LOBE = KAPPA + MAX_PARAMETERS


@dataclass(frozen=True)
class Lobe:
    """One lobe: its frame and its parameters."""

    tangent: Any
    bitangent: Any
    normal: Any
    kappa: tuple[Any, ...]

    @classmethod
    def of_numbers(cls, numbers: Sequence[Any]) -> Lobe:
        """The lobe of a row of the table: the frame is that of `frame_from_normal`."""
        sine, cosine = numbers[TURN : TURN + 2]
        x, y, z = numbers[NORMAL : NORMAL + 3]
        scale = 1.0 / (1.0 + z)
        across = mi.Vector3f(1.0 - x * x * scale, -x * y * scale, -x)
        along = mi.Vector3f(-x * y * scale, 1.0 - y * y * scale, -y)
        tangent, bitangent = cosine * across + sine * along, cosine * along - sine * across
        return cls(tangent, bitangent, mi.Vector3f(x, y, z), tuple(numbers[KAPPA:]))

    def detached(self) -> Lobe:
        """The same without gradients."""
        kappa = tuple(dr.detach(number) for number in self.kappa)
        axes = self.tangent, self.bitangent, self.normal
        tangent, bitangent, normal = (dr.detach(axis) for axis in axes)
        return Lobe(tangent, bitangent, normal, kappa)

    def local(self, w: Any) -> Any:
        """A direction in the frame of the lobe."""
        axes = (self.tangent, self.bitangent, self.normal)
        return mi.Vector3f(*(dr.dot(axis, w) for axis in axes))

    def above(self, w: Any) -> Any:
        """A direction of the frame of the lobe, where under the horizon of the texel mirrored."""
        wi = w.x * self.tangent + w.y * self.bitangent + w.z * self.normal
        return mi.Vector3f(wi.x, wi.y, dr.maximum(dr.abs(wi.z), LOWEST_Z))

    def mirrored(self, local: Any, z: Any) -> Any:
        """A direction of local numbers and height z, mirrored at the horizon of the texel."""
        return local - (2.0 * z) * mi.Vector3f(self.tangent.z, self.bitangent.z, self.normal.z)


@dataclass(frozen=True)
class Lobes:
    """The lobes of a model.

    Attributes:
        table: `[J, LOBE]`.
        kind: place among `twins` of each lobe, `[J]`.
        twins: the models in use.
        horizon: angle over its own horizon within which a lobe fades for views, in radians.
        lowest: z of the lowest measured light; 0 lets none fade.
    """

    table: Any
    kind: Any
    twins: tuple[Twin, ...]
    horizon: float
    lowest: float

    def of(self, index: Any) -> Lobe:
        """Lobe `index`."""
        return Lobe.of_numbers(row(self.table, index, LOBE))

    def sees(self, index: Any, wo: Any) -> Any:
        """Whether wo is above the horizons of lobe `index` and of the texel."""
        normal = mi.Vector3f(*row(self.table, index, LOBE)[NORMAL:KAPPA])
        return (dr.dot(normal, wo) > 0.0) & (wo.z > 0.0)

    def sample(self, index: Any, wo: Any, u: Sequence[Any]) -> Any:
        """wi above the horizon of the texel, drawn from lobe `index` by three numbers."""
        lobe, kind = self.of(index), one(self.kind, index)
        found, given = mi.Vector3f(0.0), (lobe.kappa, raised(lobe.local(wo)), tuple(u))
        for number, twin in enumerate(self.twins):
            found = branch(kind == number, twin.sample, found, *given)
        return lobe.above(found)

    def rho(self, twin: Twin, lobe: Lobe, light: Any, wi: Any, wo: Any) -> Any:
        """rho_j of a lobe [WDR11 Eq. 3] of local wi and wo; `light` is wi over the horizon."""
        lit, cosine = (wi.z > 0.0) & (wo.z > 0.0), wi.z
        if self.lowest > 0.0:
            excess = dr.maximum(cosine - lobe.normal.z * light.z, 0.0)
            cosine = cosine - (1.0 - dr.minimum(light.z / self.lowest, 1.0)) * excess
        if self.horizon > 0.0:
            t = dr.clip(wo.z / math.sin(self.horizon), 0.0, 1.0)
            cosine = cosine * (t * t * (3.0 - 2.0 * t))
        return dr.select(lit, twin.eval(lobe.kappa, wi, wo) * cosine, 0.0)


def density(twin: Twin, lobe: Lobe, light: Any, wi: Any, view: Any) -> Any:
    """Density of `Lobes.sample` at a local wi, of a raised view; `light` is wi over the horizon."""
    upper = twin.pdf(lobe.kappa, wi, view)
    return upper + twin.pdf(lobe.kappa, lobe.mirrored(wi, light.z), view)


def raised(w: Any) -> Any:
    """A view in the frame of a lobe, mirrored and lifted above its horizon."""
    return dr.normalize(mi.Vector3f(w.x, w.y, dr.maximum(dr.abs(w.z), COS_EPS)))
