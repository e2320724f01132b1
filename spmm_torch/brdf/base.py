"""What every analytical BRDF is: a name, a table of parameters, and `eval` in its local frame."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

INV_PI = 1.0 / math.pi
# Cosines are kept from zero in denominators: 0.06 degrees above the horizon no gonioreflectometer
# measures any more, and powers of 1/cos stay far from overflow in float32.
COS_EPS = 1e-3
# Leaves room for the factors of a lobe above the smallest normal number.
EXPONENT_MARGIN = 7.0
# Widths that models are searched from, about a factor of two apart: the search bridges that gap.
EXPONENTS = (4.0, 16.0, 64.0, 256.0)
SLOPES = (0.1, 0.2, 0.4, 0.7)
# About as narrow as a measured direction stands for.
NARROW_EXPONENTS = (256.0, 1000.0)
NARROW_SLOPES = (0.03, 0.06)


@dataclass(frozen=True)
class Parameter:
    """One row of a BRDF's parameter table.

    Attributes:
        name: the field's name for it.
        low, high: physical bounds, inclusive.
        scale: `"linear"`, or `"log"` where ratios matter; the search moves on this scale.
        meaning: what it does, with its unit.
        from_width: for a parameter that sets the width of the lobe, its value for a lobe of
            given width, a power law; None for the others. The width is the slope of the half
            vector (tangent of its angle) at which a lobe seen along the normal has fallen to 1/e.
    """

    name: str
    low: float
    high: float
    scale: str
    meaning: str
    from_width: Callable[[float], float] | None = None

    def to_unit(self, value: Tensor) -> Tensor:
        """Maps `[low, high]` to `[0, 1]` on the parameter's scale."""
        if self.scale == "log":
            return torch.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def from_unit(self, unit: Tensor) -> Tensor:
        """Maps `[0, 1]` to `[low, high]` on the parameter's scale."""
        if self.scale == "log":
            return self.low * torch.exp(unit * math.log(self.high / self.low))
        return self.low + unit * (self.high - self.low)


class BRDF(ABC):
    """An analytical BRDF in its local frame, where z is the normal and x the tangent.

    Attributes:
        name: in settings and model files, as in the registry.
        title: in pictures and pages.
        references: sources in full: authors, title, venue, year; that of the model first.
        parameters: the table of kappa, P rows.
        shapes: kappa of the lobes that every search starts from.
        peak_shapes: kappa of narrow lobes, tried only where values peak; for some models.
        anisotropic: whether it has a tangent. Its first two parameters are then the widths along
            tangent and bitangent.
        reciprocal: whether wi and wo may change places.
        largest_weight: bound of f_r cos_theta_i / pdf over samples at views of up to 85 degrees;
            1 for a sampler that follows its lobe.
    """

    name: str
    title: str
    references: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    shapes: tuple[tuple[float, ...], ...]
    peak_shapes: tuple[tuple[float, ...], ...] = ()
    anisotropic: bool
    reciprocal: bool
    largest_weight: float = 1.0

    @classmethod
    def check(cls, name: str) -> None:
        """Checks what a class says of its model.

        Args:
            name: of the model in the registry.

        Raises:
            TypeError: an attribute is missing, the name is another one, or a shape does not have
                P values; the text follows the name of the class.
        """
        for attribute in BRDF.__annotations__:
            if not hasattr(cls, attribute):
                raise TypeError(f"lacks {attribute!r}; define it as BRDF in brdf/base.py says.")
        if cls.name != name:
            raise TypeError(
                f"has the name {cls.name!r}, and {name!r} in brdf/__init__.py; make the two equal."
            )
        for shape in (*cls.shapes, *cls.peak_shapes):
            if len(shape) != len(cls.parameters):
                raise TypeError(
                    f"has the shape {shape}; expected one value for each of its "
                    f"{len(cls.parameters)} parameters."
                )

    @abstractmethod
    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r without the cosine, in 1/sr: kappa `[..., P]`, wi and wo `[..., 3]` -> `[...]`.

        Leading dimensions broadcast. The value is 0 where wi or wo is under the horizon; values
        and gradients are finite everywhere.
        """

    @abstractmethod
    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """wi `[..., 3]` drawn by `u [..., 3]` in [0, 1): u[0] for choices, the others for angles.

        wo is above the horizon; wi may fall under it, where the value is 0.
        """

    @abstractmethod
    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density `[...]` of `sample` at wi, in 1/sr; it integrates to 1 over the whole sphere."""


@dataclass(frozen=True)
class HalfVector:
    """Products of the unnormalized half vector wi + wo, all `[...]`, that the models share."""

    x_squared: Tensor
    y_squared: Tensor
    z: Tensor
    length_squared: Tensor

    @property
    def planar_squared(self) -> Tensor:
        """Squared length of its projection on the surface."""
        return self.x_squared + self.y_squared

    @property
    def cos_theta_d(self) -> Tensor:
        """Cosine of the difference angle, h . wi: half the length of wi + wo."""
        return 0.5 * torch.sqrt(self.length_squared)


def half_vector(wi: Tensor, wo: Tensor) -> HalfVector:
    """The half vector of local wi and wo `[..., 3]`; z is kept from zero, for opposite ones."""
    x = wi[..., 0] + wo[..., 0]
    y = wi[..., 1] + wo[..., 1]
    z = (wi[..., 2] + wo[..., 2]).clamp(min=COS_EPS)
    x_squared, y_squared = x * x, y * y
    return HalfVector(x_squared, y_squared, z, x_squared + y_squared + z * z)


def above_horizon(wi: Tensor, wo: Tensor) -> Tensor:
    """1 where both directions `[..., 3]` are above the horizon, else 0, in their own type.

    By arithmetic: on a CPU, comparing and multiplying by bools takes four times as long.
    """
    return (wi[..., 2].clamp(0.0, 1.0) * wo[..., 2].clamp(0.0, 1.0)).ceil()


def exp_of_negative(exponent: Tensor) -> Tensor:
    """exp of `exponent [...]` <= 0, kept above the smallest normal number of its type.

    Nothing is lost below it, but there a CPU takes ten times as long.
    """
    least = math.log(torch.finfo(exponent.dtype).tiny) + EXPONENT_MARGIN
    return torch.exp(exponent.clamp(min=least))


def guarded_cosines(wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """(cos_theta_i, cos_theta_o), kept from zero so that they may stand in a denominator."""
    return wi[..., 2].clamp(min=COS_EPS), wo[..., 2].clamp(min=COS_EPS)


def schlick_fresnel(f0: Tensor, cos_theta_d: Tensor) -> Tensor:
    """Schlick's approximation of the Fresnel term; f0 at normal incidence, all `[...]`.

    Source: C. Schlick, An Inexpensive BRDF Model for Physically-based Rendering, Computer Graphics
    Forum 13(3), 233-246, 1994, Eq. 15.
    """
    grazing = (1.0 - cos_theta_d).clamp(min=0.0)
    squared = grazing * grazing
    return f0 + (1.0 - f0) * squared * squared * grazing
