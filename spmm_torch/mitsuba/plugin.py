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

    def seen(self, uv: Any, wo: Any) -> Any:
        """What the view shows at uv of the texture, v up: all that no light decides."""
        ...

    def evaluated(self, seen: Any, wi: Any) -> tuple[Any, Any]:
        """(cosine-weighted RGB, density of `sample` in 1/sr) at wi; 0 under the horizon."""
        ...

    def sample(self, seen: Any, u: Sequence[Any]) -> Any:
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
            self._kept: tuple[Any, _Query] | None = None

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            query = self._query(ctx, si, active)
            found = query.evaluated(query.frame.local(wo))
            if dr.flag(dr.JitFlag.SymbolicScope):
                self._kept = _state(ctx, si, active), query
            return found

        def sample(self, ctx: Any, si: Any, first: Any, others: Any, active: Any = True) -> Any:
            query = self._query(ctx, si, active)
            drawn = query.drawn(first, others)
            return query.sample(drawn, *query.evaluated(drawn))

        def _query(self, ctx: Any, si: Any, active: Any) -> _Query:
            """The query of a point and view: that of `eval_pdf` where `sample` follows on it."""
            kept, self._kept = self._kept, None
            if kept is not None and kept[0] == _state(ctx, si, active):
                return kept[1]
            return _Query(self, ctx, si, active)

        def traverse(self, callback: Any) -> None:
            for key, value in self.reflector.parameters.items():
                callback.put(key, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            self.reflector.update([key for key in keys if key in self.reflector.parameters])

        def to_string(self) -> str:
            return f"{name}[]"

    return MeasuredBSDF


class _Query:
    """A BSDF at one point and view; what no light decides is found once.

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
        self.seen = self.reflector.seen(self.uv, self.wo)

    def evaluated(self, wi: Any) -> tuple[Any, Any]:
        """(RGB, density of `drawn`) of wi."""
        wi = _valid(wi)
        value, density = self.reflector.evaluated(self.seen, wi)
        if self.from_light:
            value = self._turned(wi)
        above = self.active & (wi.z > 0.0)
        return dr.select(above, value, mi.Color3f(0.0)), dr.select(above, density, mi.Float(0.0))

    def drawn(self, first: Any, others: Any) -> Any:
        """wi of the numbers of Mitsuba."""
        u = (first, others.x, others.y)
        return dr.detach(self.reflector.sample(self.seen, u))

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

    def _turned(self, wi: Any) -> Any:
        """The value of light that comes from wo and goes to wi, for tracers of light."""
        found, _ = self.reflector.evaluated(self.reflector.seen(self.uv, wi), self.wo)
        return found * (wi.z / dr.maximum(self.wo.z, LEAST_COSINE))


def _state(ctx: Any, si: Any, active: Any) -> tuple[Any, ...]:
    """What two calls have in common if they ask for the same point and view, one after another.

    Mitsuba's `eval_pdf_sample` calls `eval_pdf` and `sample` of a plug-in in Python. The scope is
    another one as soon as a branch or a loop lies between two calls.
    """
    given = si.wi, si.uv, si.dp_du, si.dp_dv, si.sh_frame, mi.Bool(active)
    backend = dr.backend_v(mi.Float)
    return dr.detail.scope(backend), ctx.mode, ctx.type_mask, *dr.detail.collect_indices(given)


def _valid(w: Any) -> Any:
    """A direction, or the one straight down where its numbers are none."""
    return dr.select(dr.isfinite(dr.dot(w, w)), w, mi.Vector3f(0.0, 0.0, -1.0))
