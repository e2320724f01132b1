"""The interface of an analytical BRDF: name, parameter table, `eval`, `sample` and `pdf`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from types import EllipsisType
from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from .slopes import LocalPairs, Slopes

INV_PI = 1.0 / math.pi
# Least cosine in a denominator, 0.06 degrees above the horizon: lower than gonioreflectometers
# measure, and powers of 1/cos stay far from overflow in float32.
COS_EPS = 1e-3
# Room for the other factors of a lobe above the smallest normal number.
EXPONENT_MARGIN = 7.0
# Widths that a search starts from, about a factor of two apart: the search bridges that gap.
EXPONENTS = (4.0, 16.0, 64.0, 256.0)
SLOPES = (0.1, 0.2, 0.4, 0.7)
# Widths of about the spacing of measured directions.
NARROW_EXPONENTS = (256.0, 1000.0)
NARROW_SLOPES = (0.03, 0.06)


@dataclass(frozen=True)
class Parameter:
    """One row of the parameter table of a BRDF.

    Attributes:
        name: its name in the field.
        low, high: physical bounds, inclusive.
        scale: `"linear"`, or `"log"` where ratios matter; the scale of the search.
        meaning: its effect, with its unit.
        from_width: the value for a lobe of given width, a power law; None for parameters that do
            not set the width. The width is the slope (tangent of the angle) of the half vector at
            which a lobe seen along the normal has fallen to 1/e.
    """

    name: str
    low: float
    high: float
    scale: str
    meaning: str
    from_width: Callable[[float], float] | None = None

    @property
    def narrow_is_low(self) -> bool:
        """Whether small values make lobes narrow, of a parameter that sets the width."""
        return self.from_width is not None and self.from_width(2.0) > self.from_width(1.0)

    def slope(self, value: Tensor) -> Tensor:
        """d value / d unit of `from_unit`, `[...]`, at values `[...]` of low to high."""
        if self.scale == "log":
            return value * math.log(self.high / self.low)
        return torch.full_like(value, self.high - self.low)

    def to_unit(self, value: Tensor) -> Tensor:
        """Values `[...]` of 0 to 1 from those of low to high, on the scale of the parameter."""
        if self.scale == "log":
            return torch.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def from_unit(self, unit: Tensor) -> Tensor:
        """Values `[...]` of low to high from those of 0 to 1, on the scale of the parameter."""
        if self.scale == "log":
            return self.low * torch.exp(unit * math.log(self.high / self.low))
        return self.low + unit * (self.high - self.low)


class BRDF(ABC):
    """An analytical BRDF in its local frame, where z is the normal and x the tangent.

    Attributes:
        name: of the registry, in settings and model files.
        title: name in pictures and pages.
        references: full sources (authors, title, venue, year), that of the model first.
        parameters: the table of kappa, P rows.
        shapes: kappa of the lobes in the bank, from which every search starts.
        peak_shapes: kappa of narrow lobes, tried only where values peak; may be empty.
        anisotropic: whether the model has a tangent. Its first two parameters are then the widths
            along tangent and bitangent.
        reciprocal: whether f_r stays the same if wi and wo are exchanged.
        largest_weight: bound of f_r cos_theta_i / pdf of samples, at views up to 85 degrees; 1 for
            a sampler that follows the lobe.
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
        and gradients are finite everywhere. All three may be `Vectors`: they are read by their
        components, `wi[..., 2]`, and their shape, and in no other way.
        """

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes | None:
        """f_r and its logarithmic derivatives, of parameters `kappa [J, P, ...]` at local pairs.

        For speed alone: without them, None, derivatives are recorded.
        """
        return None

    @abstractmethod
    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """wi `[..., 3]` of `u [..., 3]` in [0, 1): u[0] makes choices, u[1] and u[2] give angles.

        wo is above the horizon; wi may be under it, where f_r is 0.
        """

    @abstractmethod
    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density `[...]` of `sample` at wi, in 1/sr; it integrates to 1 over the whole sphere."""


@dataclass(frozen=True)
class Vectors:
    """Vectors by their components, `[...]` each, read as those of a tensor: `w[..., 2]` is z.

    Components that were just computed need not be copied into one tensor to be read from it, and
    none has a gradient as large as all of them.
    """

    parts: tuple[Tensor, ...]

    def __getitem__(self, index: tuple[EllipsisType, int]) -> Tensor:
        """A component `[...]`, given `..., 0` and so on."""
        return self.parts[index[1]]

    @property
    def shape(self) -> torch.Size:
        """That of a tensor `[..., N]` of all components."""
        return torch.Size((*self.parts[0].shape, len(self.parts)))


@dataclass(frozen=True)
class HalfVector:
    """Components and lengths of the unnormalized half vector wi + wo, `[...]` each."""

    x_squared: Tensor
    y_squared: Tensor
    z: Tensor
    length_squared: Tensor

    @property
    def planar_squared(self) -> Tensor:
        """Squared length of its projection on the surface, `[...]`."""
        return self.x_squared + self.y_squared

    @property
    def cos_theta_d(self) -> Tensor:
        """Cosine of the difference angle, h . wi, `[...]`: half the length of wi + wo."""
        return 0.5 * torch.sqrt(self.length_squared)


def half_vector(wi: Tensor, wo: Tensor) -> HalfVector:
    """The half vector of local wi and wo `[..., 3]`; z is at least COS_EPS, for opposite ones."""
    x = wi[..., 0] + wo[..., 0]
    y = wi[..., 1] + wo[..., 1]
    z = (wi[..., 2] + wo[..., 2]).clamp(min=COS_EPS)
    x_squared, y_squared = x * x, y * y
    return HalfVector(x_squared, y_squared, z, x_squared + y_squared + z * z)


def above_horizon(wi: Tensor, wo: Tensor) -> Tensor:
    """1 where both directions `[..., 3]` are above the horizon, else 0, in their own type.

    Arithmetic is four times as fast as a comparison and a product with bools on a CPU. A step
    has no gradient, so none is passed through it.
    """
    return torch.minimum(wi[..., 2].detach(), wo[..., 2].detach()).clamp(0.0, 1.0).ceil()


def exp_of_negative(exponent: Tensor) -> Tensor:
    """exp of `exponent [...]` <= 0, at least the smallest normal number of its type.

    Smaller numbers are as good as 0, but a CPU takes ten times as long with them.
    """
    least = math.log(torch.finfo(exponent.dtype).tiny) + EXPONENT_MARGIN
    return torch.exp(exponent.clamp(min=least))


def guarded_cosines(wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """(cos_theta_i `[...]`, cos_theta_o `[...]`), at least COS_EPS, for use in denominators."""
    return wi[..., 2].clamp(min=COS_EPS), wo[..., 2].clamp(min=COS_EPS)


def schlick_fresnel(f0: Tensor, cos_theta_d: Tensor) -> Tensor:
    """Schlick's approximation of the Fresnel term, `[...]`, with f0 at normal incidence.

    Source: C. Schlick, An Inexpensive BRDF Model for Physically-based Rendering, Computer Graphics
    Forum 13(3), 233-246, 1994, Eq. 15.
    """
    grazing = (1.0 - cos_theta_d).clamp(min=0.0)
    squared = grazing * grazing
    return f0 + (1.0 - f0) * squared * squared * grazing
