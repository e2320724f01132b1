"""The registry of analytical BRDFs [WDR11 §3.1]. A new one is one file and one line in `CLASSES`.

Names are known without torch, for settings and help texts. The models are imported at first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .base import BRDF, Parameter

# Module and class of each model. Its position is its index in memory: add at the end.
CLASSES: dict[str, str] = {
    "lambertian": "lambertian.Lambertian",
    "oren_nayar": "oren_nayar.OrenNayar",
    "blinn_phong": "blinn_phong.BlinnPhong",
    "ward": "ward.Ward",
    "cook_torrance": "cook_torrance.CookTorrance",
    "lafortune": "lafortune.Lafortune",
    "ashikhmin_shirley": "ashikhmin_shirley.AshikhminShirley",
    "ward_duer": "ward.WardDuer",
    "ggx": "ggx.GGX",
}
MODEL_NAMES: tuple[str, ...] = tuple(CLASSES)
# The seven models of the paper, which a fit uses by default. Others are options, so that adding a
# model changes no fit.
PAPER_MODELS: tuple[str, ...] = MODEL_NAMES[:7]

REGISTRY: tuple[BRDF, ...]
MAX_PARAMETERS: int

__all__ = ["MAX_PARAMETERS", "MODEL_NAMES", "PAPER_MODELS", "REGISTRY", "BRDF", "Parameter"]


def __getattr__(name: str) -> Any:
    """Names that need the models, at first use."""
    if name in ("REGISTRY", "MAX_PARAMETERS"):
        models = tuple(_model(name, place) for name, place in CLASSES.items())
        widest = max(len(model.parameters) for model in models)
        globals().update(REGISTRY=models, MAX_PARAMETERS=widest)
        return globals()[name]
    if name in ("BRDF", "Parameter"):
        return getattr(import_module(".base", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _model(name: str, place: str) -> BRDF:
    """The model that is registered as `name`.

    Args:
        name: in the registry.
        place: its module and its class.

    Raises:
        ImportError: the module has no such class, or the class is not complete.
    """
    module, _, kind = place.rpartition(".")
    found = import_module(f".{module}", __name__)
    if not hasattr(found, kind):
        raise ImportError(f"brdf/__init__.py names {kind}, which brdf/{module}.py does not define.")
    try:
        getattr(found, kind).check(name)
    except TypeError as error:
        raise ImportError(f"{kind} in brdf/{module}.py {error}") from error
    return getattr(found, kind)()
