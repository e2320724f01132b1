"""Values of a BRDF with their logarithmic derivatives, which a search for lobes asks for.

No rotation of a lobe changes the angle between wi and wo. So f_r is taken as a function of the two
cosines and of the half vector at a fixed angle, which leaves few terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from .base import COS_EPS


@dataclass(frozen=True)
class Angles:
    """What no rotation changes of pairs of directions, `[1, ...]` each.

    Attributes:
        cosine: wi . wo.
        length_squared: of wi + wo.
        cos_theta_d: cosine of the difference angle, half the length of wi + wo.
        grazing: (1 - cos_theta_d)^5 of Schlick's Fresnel term.
    """

    cosine: Tensor
    length_squared: Tensor
    cos_theta_d: Tensor
    grazing: Tensor

    @classmethod
    def between(cls, wi: Tensor, wo: Tensor) -> Angles:
        """The angles of `wi [1, ..., 3]` and `wo [1, ..., 3]`, which broadcast."""
        length_squared = (wi + wo).square().sum(-1).clamp(min=COS_EPS * COS_EPS)
        cos_theta_d = 0.5 * torch.sqrt(length_squared)
        grazing = (1.0 - cos_theta_d).clamp(min=0.0) ** 5
        return cls((wi * wo).sum(-1), length_squared, cos_theta_d, grazing)

    @cached_property
    def direct(self) -> Tensor:
        """1 - `grazing`, `[1, ...]`: d F / d f0 of Schlick's Fresnel term F."""
        return 1.0 - self.grazing

    @cached_property
    def groove(self) -> Tensor:
        """4 / |wi + wo|^2, `[1, ...]`, of the V-groove term."""
        return 4.0 / self.length_squared

    def fresnel(self, f0: Tensor) -> Tensor:
        """Schlick's Fresnel term with `f0 [...]` at normal incidence, see `schlick_fresnel`."""
        return f0 + (1.0 - f0) * self.grazing


@dataclass(frozen=True)
class LocalPairs:
    """Pairs of directions in the frames of J lobes, and what several models ask of them.

    Attributes:
        wi, wo: `[J, 3, ...]`, which broadcast.
        cosines: cos_theta_i and cos_theta_o as by `guarded_cosines`, `[J, ...]` each.
        falls: d log(1 / cosine) along the cosine, of both; 0 where it is guarded.
        angles: between wi and wo.
    """

    wi: Tensor
    wo: Tensor
    cosines: tuple[Tensor, Tensor]
    falls: tuple[Tensor, Tensor]
    angles: Angles

    def __getitem__(self, rows: slice) -> LocalPairs:
        """The pairs of some lobes, of which everything is known once it is for all lobes."""
        (cosine_i, cosine_o), (fall_i, fall_o) = self.cosines, self.falls
        cosines, falls = (cosine_i[rows], cosine_o[rows]), (fall_i[rows], fall_o[rows])
        some = LocalPairs(self.wi[rows], self.wo[rows], cosines, falls, self.angles)
        for name in ("half", "planar_squared", "planar_cosine", "log_cos_theta_h", "of_wi"):
            some.__dict__[name] = getattr(self, name)[rows]
        return some

    @cached_property
    def half(self) -> Tensor:
        """wi + wo `[J, 3, ...]`; z is at least COS_EPS, for opposite ones."""
        half = self.wi + self.wo
        half[:, 2].clamp_(min=COS_EPS)
        return half

    @cached_property
    def planar_squared(self) -> Tensor:
        """Squared length `[J, ...]` of the projection of wi + wo on the surface."""
        x, y = self.half[:, 0], self.half[:, 1]
        return (x * x).addcmul_(y, y)

    @cached_property
    def planar_cosine(self) -> Tensor:
        """Product `[J, ...]` of the projections of wi and of wo on the surface."""
        return torch.addcmul(self.angles.cosine, self.wi[:, 2], self.wo[:, 2], value=-1.0)

    @cached_property
    def of_wi(self) -> Tensor:
        """1 where cos_theta_i is above cos_theta_o, else 0, `[J, ...]`."""
        return is_above(*self.cosines)

    @cached_property
    def log_cos_theta_h(self) -> Tensor:
        """log of the cosine of the half vector, `[J, ...]`; d along its z is 1 / z."""
        z = self.half[:, 2]
        return (self.planar_squared / (z * z)).log1p_().mul_(-0.5)


@dataclass(frozen=True)
class Slopes:
    """f_r of J lobes where both directions are above the horizon, and derivatives of its logarithm.

    Where f_r is 0 the derivatives are finite, of any value. None stands for 0.

    Attributes:
        value: f_r `[J, ...]`.
        kappa: along the parameters of the model, P tensors `[J, ...]`.
        cos_theta_i, cos_theta_o: along z of wi and of wo, `[J, ...]`, which broadcast.
        half: along x, y and z of wi + wo, `[J, ...]` each.
    """

    value: Tensor
    kappa: tuple[Tensor, ...] = ()
    cos_theta_i: Tensor | None = None
    cos_theta_o: Tensor | None = None
    half: tuple[Tensor | None, Tensor | None, Tensor | None] = (None, None, None)


def is_above(value: Tensor, limit: Tensor | float) -> Tensor:
    """1 where `value [...]` is above `limit [...]`, else 0, in its own type.

    A comparison in place gives no bools, whose products are slow.
    """
    return (value - limit).gt_(0.0)
