"""Selections from what a user points at: pictures, clusters, colours, properties of lobes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image, UnidentifiedImageError
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..errors import ConfigError, DataError
from ..lobes.sampling import SPECULAR_WIDTH, specular_mask
from ..model.spmm import SPMM
from .selection import Selection, select_lobes, select_texels
from .widths import widths

CODE_MAX = 255.0


def picture_selection(model: SPMM, path: Path | str) -> Selection:
    """Texels by a grey picture of the size of the texture: white is 1, black 0, grey between.

    Raises:
        DataError: the file cannot be read as a picture.
        ConfigError: it has another size.
    """
    try:
        with Image.open(path) as image:
            codes = np.asarray(image.convert("L"))
    except (OSError, UnidentifiedImageError, ValueError) as error:
        raise DataError(
            f"mask {path} cannot be read ({error}); expected a picture such as a PNG; check it."
        ) from error
    return select_texels(model, torch.from_numpy(codes / CODE_MAX).to(model.weight))


def cluster_selection(model: SPMM, clusters: Sequence[int]) -> Selection:
    """The texels of some clusters, by their numbers.

    Raises:
        ConfigError: no such cluster.
    """
    for cluster in clusters:
        if not 0 <= cluster < model.cluster_count:
            raise ConfigError(
                f"cluster {cluster} does not exist; expected 0 to {model.cluster_count - 1}."
            )
    wanted = torch.tensor(list(clusters), device=model.labels.device)
    return select_texels(model, torch.isin(model.labels, wanted))


@torch.no_grad()
def colour_selection(
    model: SPMM,
    wi: Tensor,
    wo: Tensor,
    low: Sequence[float],
    high: Sequence[float],
    soft: float = 0.0,
) -> Selection:
    """Texels whose colour under one light and view lies in a range.

    Args:
        wi, wo: unit directions `[3]` of the slice of the texture.
        low, high: linear cosine-weighted values of each channel, as `SPMM.picture` gives them.
        soft: how far outside of the range, in the same values, shares fade to 0.

    Raises:
        ConfigError: bounds that are not one number a channel, or in the wrong order.
    """
    picture = model.picture(wi.to(model.weight), wo.to(model.weight))
    bounds = torch.tensor([list(low), list(high)]).to(picture) if len(low) == len(high) else None
    channels = picture.shape[2]
    if bounds is None or bounds.shape[1] != channels or bool((bounds[0] > bounds[1]).any()):
        raise ConfigError(
            f"the colour range is {list(low)} to {list(high)}; expected {channels} numbers each, "
            f"the lower ones first."
        )
    outside = torch.maximum(bounds[0] - picture, picture - bounds[1]).amax(2)  # [H, W]
    if soft > 0.0:
        return select_texels(model, (1.0 - outside / soft).clamp(0.0, 1.0))
    return select_texels(model, outside <= 0.0)


@torch.no_grad()
def lobe_selection(
    model: SPMM,
    models: Sequence[str] | None = None,
    specular: bool | None = None,
    width: tuple[float, float] | None = None,
    elevation: tuple[float, float] | None = None,
    threshold: float = SPECULAR_WIDTH,
) -> Selection:
    """Lobes that have all of the given properties, in every texel.

    Args:
        models: names of BRDFs.
        specular: whether of the specular group [WDR11 §5.1].
        width: from, to, in radians (root mean square slope of the half vector); diffuse lobes have
            an infinite one.
        elevation: from, to, of the normal above the horizon in radians; pi/2 is upright.
        threshold: width under which a lobe is specular.

    Raises:
        ConfigError: an unknown BRDF.
    """
    lobes = model.dictionary.detach()
    chosen = torch.ones(len(lobes), dtype=torch.bool, device=lobes.kappa.device)
    if models is not None:
        for name in models:
            if name not in MODEL_NAMES:
                raise ConfigError(f"unknown BRDF {name}; valid: {', '.join(MODEL_NAMES)}.")
        wanted = torch.tensor([MODEL_NAMES.index(name) for name in models])
        chosen &= torch.isin(lobes.model, wanted).to(chosen.device)
    if specular is not None:
        chosen &= specular_mask(lobes, threshold) == specular
    if width is not None:
        chosen &= _between(widths(lobes), width)
    if elevation is not None:
        chosen &= _between(torch.arcsin(lobes.normal[:, 2].clamp(-1.0, 1.0)), elevation)
    return select_lobes(model, chosen)


def _between(values: Tensor, limits: tuple[float, float]) -> Tensor:
    """Which values lie in a closed range; a hair is forgiven, for angles given in degrees."""
    hair = 1e-6 * math.pi
    return (values >= limits[0] - hair) & (values <= limits[1] + hair)
