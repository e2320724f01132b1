"""The registry of analytical BRDFs [WDR11 §3.1]. A new one is one file and one line here."""

from __future__ import annotations

from .ashikhmin_shirley import AshikhminShirley
from .base import BRDF, Parameter
from .blinn_phong import BlinnPhong
from .cook_torrance import CookTorrance
from .lafortune import Lafortune
from .lambertian import Lambertian
from .oren_nayar import OrenNayar
from .ward import Ward

REGISTRY: tuple[BRDF, ...] = (
    Lambertian(),
    OrenNayar(),
    BlinnPhong(),
    Ward(),
    CookTorrance(),
    Lafortune(),
    AshikhminShirley(),
    Ward("ward_duer", duer=True),
)
MODEL_NAMES: tuple[str, ...] = tuple(model.name for model in REGISTRY)
# The seven of the paper; the rest of the registry are options.
PAPER_MODELS: tuple[str, ...] = MODEL_NAMES[:7]
MAX_PARAMETERS: int = max(len(model.parameters) for model in REGISTRY)

__all__ = ["MAX_PARAMETERS", "MODEL_NAMES", "PAPER_MODELS", "REGISTRY", "BRDF", "Parameter"]
