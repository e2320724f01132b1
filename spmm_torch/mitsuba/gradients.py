"""Gradients of the parameters of the plug-ins in a scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..errors import ConfigError
from .arrays import has_gradients
from .libraries import dr, mi

# Names of parameters, the last part of their keys.
NAMES = ("angle", "coefficients", "functions", "kappa", "normal", "residual", "weight")


def enable_gradients(parameters: Any, names: Iterable[str] = ("weight",)) -> list[str]:
    """Lets gradients of pictures flow to parameters of the models in a scene.

    Args:
        parameters: `mitsuba.traverse` of the scene.
        names: of parameters: weight, kappa, normal, angle, residual, functions, coefficients.

    Returns:
        The keys of these parameters, for an optimizer.

    Raises:
        ConfigError: the variant has no gradients, or no model has such a parameter.
    """
    if not has_gradients():
        raise ConfigError(
            f"the variant {mi.variant()} has no gradients; expected one such as llvm_ad_rgb; call "
            f"mitsuba.set_variant with it before the scene is loaded."
        )
    keys = {key: key.rpartition(".")[2] for key in parameters.keys()}  # noqa: SIM118
    known = sorted({name for name in keys.values() if name in NAMES})
    for name in names:
        if name not in known:
            raise ConfigError(
                f"the scene has no parameter {name!r}; expected some of {', '.join(known)}; "
                f"choose among these."
            )
    chosen = sorted(key for key, name in keys.items() if name in set(names))
    for key in chosen:
        dr.enable_grad(parameters[key])
    parameters.update()
    return chosen
