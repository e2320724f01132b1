"""A plug-in as a material of our renderer: the numbers that Mitsuba computes, in torch."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..config.synthesis import FAST
from ..errors import OutputError
from ..geometry.shapes import broadcast_shape
from ..runtime.atomic import is_text, readable
from ..runtime.names import text_of
from ..synthesize.variant import works
from .libraries import dr, mi
from .registration import register


def plugin_variant() -> str | None:
    """The variant that evaluates many queries at once; None where there is none."""
    return FAST if find_spec("mitsuba") is not None and works(FAST) else None


class PluginMaterial:
    """What the plug-in `spmm` says of a model file.

    Args:
        path: of the model file.
        variant: of Mitsuba, which is set; see `plugin_variant`.

    Raises:
        OutputError: the path is no UTF-8.
    """

    def __init__(self, path: Path, variant: str) -> None:
        if mi.variant() != variant:
            mi.set_variant(variant)
        register()
        name = text_of(path.absolute())
        if not is_text(name):
            raise OutputError(
                f"{readable(name)} holds bytes that are no UTF-8, which Mitsuba cannot open; "
                f"expected a name in UTF-8; choose another folder."
            )
        self._bsdf = mi.load_dict({"type": "spmm", "filename": name})

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Cosine-weighted RGB `[..., 3]` of uv `[..., 2]`, v up, and wi, wo `[..., 3]`."""
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        if not shape.numel():
            return wi.new_zeros(*shape, 3)
        flat = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        places, lights, views = (_columns(x) for x in flat)
        si = dr.zeros(mi.SurfaceInteraction3f, shape.numel())
        si.uv = mi.Point2f(places[0], 1.0 - places[1])  # row 0 lies at v = 0 there
        si.wi = mi.Vector3f(*views)
        value = self._bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*lights))
        found = torch.from_numpy(np.array(value).T.copy())
        return found.to(wi).view(*shape, 3)


def _columns(rows: Tensor) -> list[np.ndarray]:
    return [np.ascontiguousarray(column) for column in rows.detach().cpu().T.float().numpy()]
