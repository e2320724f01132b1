"""The interface of materials, and the sampler of those without their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from torch import Tensor

from ..geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from ..model.spmm import SPMM

# Width of lobes whose highlights show the single directions of fixed lights, in radians.
NARROW_WIDTH = 0.12
# Share of the reflected light up to which such highlights do not show.
NARROW_SHARE = 0.01


class Material(Protocol):
    """Cosine-weighted reflectance; an `SPMM` is a material."""

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Linear RGB `[..., 3]` of uv `[..., 2]` and local unit wi, wo `[..., 3]`.

        Leading dimensions broadcast, the texture repeats, and the value is 0 where wi or wo is
        under the horizon.
        """
        ...


@runtime_checkable
class SampledMaterial(Protocol):
    """A material that samples light directions by importance."""

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """As in `Material`."""
        ...

    def sample(self, uv: Tensor, wo: Tensor, u: Tensor, /) -> tuple[Tensor, Tensor, Tensor]:
        """Directions wi, values `[..., 3]` and pdf `[...]` of numbers u `[..., 3]` in [0, 1)."""
        ...

    def pdf(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Density `[...]` in 1/sr with which `sample` yields wi."""
        ...


@dataclass(frozen=True)
class CosineSampled:
    """A material sampled like a diffuse one, so that every direction is possible."""

    material: Material

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """The value of the material itself."""
        return self.material(uv, wi, wo)

    def sample(self, uv: Tensor, wo: Tensor, u: Tensor, /) -> tuple[Tensor, Tensor, Tensor]:
        """Directions, values and pdf of u `[..., 3]`; its third number is not used."""
        wi = square_to_cosine_hemisphere(u[..., :2])
        return wi, self.material(uv, wi, wo), self.pdf(uv, wi, wo)

    def pdf(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """cos(theta_i) / pi `[...]`."""
        return square_to_cosine_hemisphere_pdf(wi)


def has_narrow_highlights(material: Material) -> bool:
    """Whether lobes narrower than the gaps between fixed lights reflect a visible part."""
    model = material.material if isinstance(material, CosineSampled) else material
    return isinstance(model, SPMM) and model.narrow_share(NARROW_WIDTH) > NARROW_SHARE


def with_sampler(material: Material) -> SampledMaterial:
    """The material itself if it has a sampler, else `CosineSampled`."""
    return material if isinstance(material, SampledMaterial) else CosineSampled(material)
