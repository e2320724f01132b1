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

    def evaluated(
        self, place: Any, chances: Any, lights: Sequence[Any], wo: Any
    ) -> tuple[list[Any], list[Any]]:
        """(cosine-weighted RGB, density of `sample` in 1/sr) at each wi; 0 under the horizon.

        Without chances, None, densities have no meaning.
        """
        ...

    def shares(self, place: Any, wo: Any) -> Any:
        """What `sample` and densities need of a view."""
        ...

    def sample(self, place: Any, chances: Any, wo: Any, u: Sequence[Any]) -> Any:
        """wi over the horizon of three numbers in [0, 1)."""
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
            return query.evaluated([query.frame.local(wo)])[0][0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            return query.evaluated([query.frame.local(wo)])[1][0]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            (value,), (density,) = query.evaluated([query.frame.local(wo)])
            return value, density

        def sample(self, ctx: Any, si: Any, first: Any, others: Any, active: Any = True) -> Any:
            query = _Query(self, ctx, si, active)
            drawn = query.drawn(first, others)
            (value,), (density,) = query.evaluated([drawn])
            return query.sample(drawn, value, density)

        def eval_pdf_sample(
            self, ctx: Any, si: Any, wo: Any, first: Any, others: Any, active: Any = True
        ) -> Any:
            query = _Query(self, ctx, si, active)
            drawn = query.drawn(first, others)
            values, densities = query.evaluated([query.frame.local(wo), drawn])
            return values[0], densities[0], *query.sample(drawn, values[1], densities[1])

        def traverse(self, callback: Any) -> None:
            for key, value in self.reflector.parameters.items():
                callback.put(key, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            self.reflector.update([key for key in keys if key in self.reflector.parameters])

        def to_string(self) -> str:
            return f"{name}[]"

    return MeasuredBSDF


class _Query:
    """A BSDF at one point and view; what its place and its sampler need is found once.

    Directions are those of the frame of the texture.
    """

    def __init__(self, bsdf: Any, ctx: Any, si: Any, active: Any) -> None:
        self.reflector = bsdf.reflector
        self.from_light = ctx.mode == mi.TransportMode.Importance
        uv, self.frame = bsdf.placement.uv(si), bsdf.placement.frame(si)
        wo = self.frame.local(si.wi)
        # A broken normal or uv must not lead reads beyond a table.
        valid = dr.isfinite(uv.x + uv.y + dr.dot(wo, wo))
        self.uv = dr.select(valid, uv, mi.Point2f(0.0))
        self.wo = dr.select(valid, wo, mi.Vector3f(0.0, 0.0, 1.0))
        enabled = ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0)
        self.active = active & valid & (si.wi.z > 0.0) & enabled
        self.place = self.reflector.place(self.uv, self.wo)
        self._shares: Any = None

    def evaluated(self, lights: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """(RGB, density of `drawn`) of each wi."""
        lights, chances = [_valid(wi) for wi in lights], self._chances()
        values, densities = self.reflector.evaluated(self.place, chances, lights, self.wo)
        if self.from_light:
            values = [self._turned(wi) for wi in lights]
        above = [self.active & (wi.z > 0.0) for wi in lights]
        return (
            [dr.select(*each, mi.Color3f(0.0)) for each in zip(above, values, strict=True)],
            [dr.select(*each, mi.Float(0.0)) for each in zip(above, densities, strict=True)],
        )

    def drawn(self, first: Any, others: Any) -> Any:
        """wi of the numbers of Mitsuba."""
        u = (first, others.x, others.y)
        return dr.detach(self.reflector.sample(self.place, self._chances(), dr.detach(self.wo), u))

    def sample(self, wi: Any, value: Any, density: Any) -> tuple[Any, Any]:
        """The sample of Mitsuba of a wi drawn, and its value over its density."""
        found = mi.BSDFSample3f()
        found.wo = self.frame.shading(wi)
        found.pdf = density
        found.eta = 1.0
        found.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        found.sampled_component = mi.UInt32(0)
        possible = density > 0.0
        weight = value / dr.select(possible, density, 1.0)
        return found, dr.select(possible, weight, mi.Color3f(0.0))

    def _chances(self) -> Any:
        """The probabilities of the sampler."""
        if self._shares is None:
            self._shares = self.reflector.shares(self.place, dr.detach(self.wo))
        return self._shares

    def _turned(self, wi: Any) -> Any:
        """The value of light that comes from wo and goes to wi, for tracers of light."""
        place = self.reflector.place(self.uv, wi)
        (found,), _ = self.reflector.evaluated(place, None, [self.wo], wi)
        return found * (wi.z / dr.maximum(self.wo.z, LEAST_COSINE))


def _valid(w: Any) -> Any:
    """A direction, or the one straight down where its numbers are none."""
    return dr.select(dr.isfinite(dr.dot(w, w)), w, mi.Vector3f(0.0, 0.0, -1.0))
