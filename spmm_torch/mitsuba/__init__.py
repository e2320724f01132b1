"""Plug-ins for Mitsuba 3: fitted models as `spmm`, measured BTFs as `btf`.

`register()` after `mitsuba.set_variant` makes both known to scenes. All of it is Dr.Jit: it is
compiled with the scene, and gradients of pictures flow to the parameters of the model.
"""

from __future__ import annotations

from .gradients import enable_gradients
from .registration import register

__all__ = ["enable_gradients", "register"]
