"""Lobes by their properties, in every texel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...config.schema import setting
from ...errors import ConfigError
from ...lobes.sampling import SPECULAR_WIDTH, specular_mask
from ...model.spmm import SPMM
from ..groups import threshold_setting
from ..options import nearest
from ..selection import Selection, select_lobes
from ..widths import widths

# Tolerance of ranges, for angles given in degrees.
TOLERANCE = 1e-6 * math.pi


@dataclass(frozen=True)
class LobesMask:
    """Lobes with all of the given properties."""

    models: tuple[str, ...] | None = setting(None, "names of BRDFs", choices=MODEL_NAMES)
    specular: bool | None = setting(None, "whether specular")
    width: tuple[float, ...] | None = setting(
        None, "least and largest width in radians (slope of the half vector)", low=0.0
    )
    elevation: tuple[float, ...] | None = setting(
        None,
        "least and largest angle of the normal above the horizon in degrees",
        low=0.0,
        high=90.0,
    )
    threshold: float = threshold_setting()

    def select(self, model: SPMM) -> Selection:
        """Its lobes in a model."""
        width, elevation = _range("width", self.width), _range("elevation", self.elevation)
        if elevation is not None:
            elevation = (math.radians(elevation[0]), math.radians(elevation[1]))
        return lobe_selection(model, self.models, self.specular, width, elevation, self.threshold)


@torch.no_grad()
def lobe_selection(
    model: SPMM,
    models: Sequence[str] | None = None,
    specular: bool | None = None,
    width: tuple[float, float] | None = None,
    elevation: tuple[float, float] | None = None,
    threshold: float = SPECULAR_WIDTH,
) -> Selection:
    """Lobes with all of the given properties, in every texel.

    Args:
        model: whose lobes are selected.
        models: names of BRDFs.
        specular: whether of the specular group [WDR11 §5.1].
        width: from, to, in radians (slope of the half vector where a lobe falls to 1/e); diffuse
            lobes have an infinite one.
        elevation: from, to, of the normal above the horizon in radians; pi/2 is upright.
        threshold: width in radians below which a lobe is specular.

    Raises:
        ConfigError: an unknown BRDF.
    """
    lobes = model.dictionary.detach()
    chosen = torch.ones(len(lobes), dtype=torch.bool, device=lobes.kappa.device)
    if models is not None:
        chosen &= _has_model(lobes.model, models)
    if specular is not None:
        chosen &= specular_mask(lobes, threshold) == specular
    if width is not None:
        chosen &= _between(widths(lobes), width)
    if elevation is not None:
        chosen &= _between(torch.arcsin(lobes.normal[:, 2].clamp(-1.0, 1.0)), elevation)
    return select_lobes(model, chosen)


def _has_model(model: Tensor, names: Sequence[str]) -> Tensor:
    """True for each index `[J]` into MODEL_NAMES of one of the names."""
    for name in names:
        if name not in MODEL_NAMES:
            raise ConfigError(f"unknown BRDF {name}; {nearest(name, MODEL_NAMES)}")
    wanted = [MODEL_NAMES.index(name) for name in names]
    return torch.isin(model, torch.tensor(wanted, device=model.device))


def _between(values: Tensor, limits: tuple[float, float]) -> Tensor:
    """True for each of the values `[J]` in a closed range."""
    return (values >= limits[0] - TOLERANCE) & (values <= limits[1] + TOLERANCE)


def _range(name: str, limits: tuple[float, ...] | None) -> tuple[float, float] | None:
    if limits is None:
        return None
    if len(limits) != 2 or limits[0] > limits[1]:
        raise ConfigError(f"{name} is {list(limits)}; expected two numbers, the lower one first.")
    return limits[0], limits[1]
