"""A pyramid of models, each fit to the values of a BTF of half the side of the one before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from torch.nn.functional import interpolate

from ..config.fit import DataConfig, FitConfig
from ..data.btf import BTF
from ..data.readers import obeying
from ..data.scattered_btf import ScatteredBTF
from ..errors import ConfigError
from ..model.pyramid import Pyramid
from .pipeline import fit
from .weighting import given_weights


def fit_pyramid(btf: BTF, config: FitConfig | None = None, levels: int | None = None) -> Pyramid:
    """Fits level by level, the finest first; each has a quarter of the texels of the one before.

    Args:
        btf: measured reflectance; the part that `config.data` selects is taken once.
        config: settings of all levels.
        levels: how many; None: down to one texel a side.

    Raises:
        ConfigError: fewer than one level, texels that are no neighbours, or a setting that cannot
            be met.
        DataError: the BTF cannot be decoded or is not valid.
    """
    if levels is not None and levels < 1:
        raise ConfigError(f"levels of a pyramid are {levels}; expected 1 at least.")
    config = config or FitConfig()
    btf = obeying(btf, config.data, config.seed)
    if btf.names is not None:
        raise ConfigError(
            f"the texels of {btf.name} are materials of their own; expected a texture, whose "
            f"neighbours have a mean; fit the materials by `fit`."
        )
    _check_levels(btf, config, levels)
    config = replace(config, data=DataConfig())  # what it asks for has been taken
    models = [fit(btf, config, render=False).model]
    while min(btf.height, btf.width) > 1 and len(models) != levels:
        btf = halved(btf)
        models.append(fit(btf, config, render=False).model)
    return Pyramid(models)


def _check_levels(btf: BTF, config: FitConfig, levels: int | None) -> None:
    """Refuses what no level under the finest can have, before that one is fit."""
    if levels == 1 or min(btf.height, btf.width) == 1:
        return
    if isinstance(btf, ScatteredBTF):
        raise ConfigError(
            f"{btf.name} holds scattered samples; expected a grid of lights and views for a "
            f"pyramid, whose levels are means of pictures; fit the samples by `fit`."
        )
    weights, kept = config.weights, []
    if config.relief.height is not None:
        kept.append("relief.height")
    if weights.file is not None and given_weights(btf, weights).texel is not None:
        kept.append("texel of weights.file")
    if kept:
        raise ConfigError(
            f"{' and '.join(kept)} of the settings is for {btf.width} x {btf.height} texels; "
            f"expected none for a pyramid, whose levels have fewer and fewer; leave it out."
        )


def halved(btf: BTF) -> BTF:
    """A BTF of half the texels a side, rounded down: means over their areas, in linear values.

    Args:
        btf: decoded here if it was not; the result keeps its values as float32.

    Raises:
        DataError: the BTF cannot be decoded.
    """
    size = max(1, btf.height // 2), max(1, btf.width // 2)
    values = np.empty((len(btf.view), len(btf.light), *size, 3), dtype=np.float32)
    for view in range(len(btf.view)):
        pictures = btf.load().pictures(view).movedim(-1, 1)  # [L, C, H, W]
        values[view] = interpolate(pictures, size=size, mode="area").movedim(1, -1).numpy()
    half = BTF.from_values(values, btf.view, btf.light, name=btf.name, negative="keep")
    return replace(half, missing=btf.missing)
