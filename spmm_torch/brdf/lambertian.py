"""Lambertian reflection: the same radiance in all directions."""

from __future__ import annotations

from torch import Tensor

from ..geometry.shapes import broadcast_shape
from ..geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from .base import BRDF, INV_PI, Parameter, above_horizon
from .slopes import LocalPairs, Slopes


class Lambertian(BRDF):
    """f_r = 1 / pi [Lambert 1760]. No parameters."""

    name, title = "lambertian", "Lambertian"
    references = (
        "J. H. Lambert, Photometria, sive de mensura et gradibus luminis, colorum et umbrae, "
        "Eberhard Klett, Augsburg, 1760.",
    )
    parameters: tuple[Parameter, ...] = ()
    shapes = ((),)
    anisotropic = False
    reciprocal = True

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        lit = above_horizon(wi, wo)
        shape = broadcast_shape(kappa.shape[:-1], lit.shape)
        return (INV_PI * lit).expand(shape)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        shape = broadcast_shape(pairs.wi[:, 2].shape, pairs.wo[:, 2].shape)
        return Slopes(pairs.wi.new_full(shape, INV_PI))

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By the cosine; see `BRDF.sample`."""
        return square_to_cosine_hemisphere(u[..., 1:])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        return square_to_cosine_hemisphere_pdf(wi)
