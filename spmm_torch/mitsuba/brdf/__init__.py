"""The BRDFs of `spmm_torch.brdf` in Dr.Jit, by the same names; a new one is one file and one line.

Formulas, ranges and sources stand with the twins in torch. Here kappa is a list of numbers, and
directions are `Vector3f` of the variant, in the frame of the lobe.
"""

from __future__ import annotations

from .ashikhmin_shirley import ASHIKHMIN_SHIRLEY
from .base import Twin
from .blinn_phong import BLINN_PHONG
from .cook_torrance import COOK_TORRANCE
from .ggx import GGX
from .lafortune import LAFORTUNE
from .lambertian import LAMBERTIAN
from .oren_nayar import OREN_NAYAR
from .ward import WARD, WARD_DUER

TWINS: dict[str, Twin] = {
    "lambertian": LAMBERTIAN,
    "oren_nayar": OREN_NAYAR,
    "blinn_phong": BLINN_PHONG,
    "ward": WARD,
    "cook_torrance": COOK_TORRANCE,
    "lafortune": LAFORTUNE,
    "ashikhmin_shirley": ASHIKHMIN_SHIRLEY,
    "ward_duer": WARD_DUER,
    "ggx": GGX,
}

__all__ = ["TWINS", "Twin"]
