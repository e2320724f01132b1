"""Making the plug-ins known to Mitsuba."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from ..data import load_btf
from ..errors import ConfigError
from ..model.spmm import SPMM
from .files import given_name, given_path
from .libraries import mi
from .material import FILTERS, Material
from .measured import Measured
from .plugin import Reflector, bsdf_class

# The variants whose light is RGB, as that of models is.
RGB = "_rgb"


def register() -> None:
    """Makes the BSDFs `spmm` and `btf` known to the variant of Mitsuba that is set.

    Raises:
        ConfigError: Mitsuba is not installed, no variant is set, or it is not one of RGB.
    """
    if find_spec("mitsuba") is None:
        raise ConfigError(
            "the plug-ins need Mitsuba 3, which is not installed; get it by "
            "pip install 'spmm_torch[mitsuba]'."
        )
    variant = mi.variant()
    if variant is None or not variant.endswith(RGB):
        raise ConfigError(
            f"the variant of Mitsuba is {variant}; expected one whose light is RGB, as that of a "
            f"model is; call mitsuba.set_variant('llvm_ad_rgb') before register()."
        )
    for name, load in LOADERS.items():
        mi.register_bsdf(name, bsdf_class(name, load))


def _spmm(properties: Any) -> Reflector:
    """The model that a plug-in `spmm` names."""
    expected = "a run folder of spmm fit, or its model.safetensors"
    path = given_path(properties, "spmm", expected)
    return Material(SPMM.load(path), given_name(properties, "filter_type", "spmm", FILTERS))


def _btf(properties: Any) -> Reflector:
    """The BTF that a plug-in `btf` names."""
    expected = "a BTF that spmm fit reads"
    return Measured(load_btf(given_path(properties, "btf", expected)).load())


LOADERS = {"spmm": _spmm, "btf": _btf}
