"""A material as a BSDF of Mitsuba, whatever evaluates it.

Mitsuba follows light backwards: its wi is the view, our wo, and its wo is the light, our wi.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from .libraries import dr, mi
from .placement import Placement

# Least cosine of a view that a light is traced from, which a value is divided by.
LEAST_COSINE = 1e-4


class Reflector(Protocol):
    """What a plug-in evaluates and samples, in the arrays of the variant; wo is the view."""

    parameters: dict[str, Any]

    def update(self, names: Sequence[str] = ()) -> None:
        """Takes parameters that have changed; none: all."""
        ...

    def place(self, uv: Any, wo: Any) -> Any:
        """What the view shows at uv of the texture, v up."""
        ...

    def value(self, place: Any, wi: Any, wo: Any) -> Any:
        """Cosine-weighted RGB; 0 where wi or wo is under the horizon."""
        ...

    def shares(self, place: Any, wo: Any) -> Any:
        """What `sample` and `density` need of a view."""
        ...

    def sample(self, place: Any, chances: Any, wo: Any, u: Sequence[Any]) -> Any:
        """wi over the horizon of three numbers in [0, 1)."""
        ...

    def density(self, place: Any, chances: Any, wi: Any, wo: Any) -> Any:
        """Density of `sample` at wi, in 1/sr."""
        ...


def bsdf_class(name: str, load: Callable[[Any], Reflector]) -> type[Any]:
    """The class of a plug-in, of the variant that is set.

    Args:
        name: of the plug-in.
        load: gives what the properties of a plug-in name.
    """

    class MeasuredBSDF(mi.BSDF):
        """A reflector on one side of a surface."""

        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            self.placement = Placement.of(properties)
            self.reflector = load(properties)
            flags = mi.BSDFFlags
            self.m_flags = (
                flags.DiffuseReflection
                | flags.GlossyReflection
                | flags.Anisotropic
                | flags.SpatiallyVarying
                | flags.FrontSide
            )
            self.m_components = [self.m_flags]

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            return query.value(wo)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            return query.density(wo)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            return query.value(wo), query.density(wo)

        def sample(self, ctx: Any, si: Any, first: Any, others: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            return query.sample(first, others)

        def eval_pdf_sample(
            self, ctx: Any, si: Any, wo: Any, first: Any, others: Any, active: Any = True
        ) -> Any:
            query = _Query(self, ctx, si, active)
            return query.value(wo), query.density(wo), *query.sample(first, others)

        def traverse(self, callback: Any) -> None:
            for key, value in self.reflector.parameters.items():
                callback.put(key, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            self.reflector.update([key for key in keys if key in self.reflector.parameters])

        def to_string(self) -> str:
            return f"{name}[]"

    return MeasuredBSDF


class _Query:
    """A BSDF at one point and view; what its place and its sampler need is found once."""

    def __init__(self, bsdf: Any, ctx: Any, si: Any, active: Any) -> None:
        self.reflector, self.uv = bsdf.reflector, bsdf.placement.uv(si)
        self.frame = bsdf.placement.frame(si)
        self.backwards = ctx.mode != mi.TransportMode.Importance
        self.wo = self.frame.local(si.wi)
        self.active = active & (si.wi.z > 0.0) & ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0)
        self.place = self.reflector.place(self.uv, self.wo)
        self._shares: Any = None

    @property
    def shares(self) -> Any:
        """The probabilities of the sampler."""
        if self._shares is None:
            self._shares = self.reflector.shares(self.place, self.wo)
        return self._shares

    def value(self, light: Any) -> Any:
        """RGB at a direction of the shading frame."""
        return self._value(self.frame.local(light), self.active & (light.z > 0.0))

    def density(self, light: Any) -> Any:
        """Density of `sample` at a direction of the shading frame."""
        wi = self.frame.local(light)
        found = self.reflector.density(self.place, self.shares, wi, self.wo)
        return dr.select(self.active & (light.z > 0.0), dr.detach(found), 0.0)

    def sample(self, first: Any, others: Any) -> tuple[Any, Any]:
        """A sample of Mitsuba, and its value over its density."""
        u = (first, others.x, others.y)
        wi = dr.detach(self.reflector.sample(self.place, self.shares, self.wo, u))
        found = mi.BSDFSample3f()
        found.wo = self.frame.shading(wi)
        found.pdf = self.density(found.wo)
        found.eta = 1.0
        found.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        found.sampled_component = mi.UInt32(0)
        active = self.active & (found.pdf > 0.0)
        weight = self._value(wi, active) / dr.select(active, found.pdf, 1.0)
        return found, dr.select(active, weight, mi.Color3f(0.0))

    def _value(self, wi: Any, active: Any) -> Any:
        """RGB at a direction of the texture's frame."""
        if self.backwards:
            found = self.reflector.value(self.place, wi, self.wo)
        else:  # light comes from wo and goes to wi
            place = self.reflector.place(self.uv, wi)
            found = self.reflector.value(place, self.wo, wi)
            found *= wi.z / dr.maximum(self.wo.z, LEAST_COSINE)
        return dr.select(active, found, mi.Color3f(0.0))
