"""Random queries, asked of torch and of a BSDF of Mitsuba."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from spmm_torch.geometry.warp import square_to_uniform_hemisphere


def random_queries(count: int, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """uv `[Q, 2]` in three copies of the texture each way, wi and wo `[Q, 3]`."""
    u = torch.rand(3, count, 2, generator=torch.Generator().manual_seed(seed))
    wi, wo = (square_to_uniform_hemisphere(part) for part in u[1:])
    return 3.0 * u[0] - 1.0, wi, wo


def interaction(mi: Any, uv: Tensor, wo: Tensor) -> Any:
    """Points of a surface whose texture lies as that of a picture does, row 0 at v = 0."""
    import drjit

    si = drjit.zeros(mi.SurfaceInteraction3f, len(uv))
    si.uv = mi.Point2f(*_columns(torch.stack((uv[:, 0], 1.0 - uv[:, 1]), dim=1)))
    si.wi = vectors(mi, wo)
    return si


def vectors(mi: Any, w: Tensor) -> Any:
    """Directions `[Q, 3]` for Mitsuba."""
    return mi.Vector3f(*_columns(w))


def values(array: Any) -> Tensor:
    """An array of Mitsuba, `[n, Q]` or `[Q]`, as `[Q, n]` or `[Q]`."""
    found = torch.from_numpy(np.array(array))
    return found.T if found.dim() == 2 else found


def _columns(rows: Tensor) -> list[np.ndarray]:
    return [np.ascontiguousarray(column) for column in rows.T.float().numpy()]
