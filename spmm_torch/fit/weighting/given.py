"""Weights of a scene, of a file, or of both, as the settings say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from ...config.fit import WeightsConfig
from ...data import BTF
from ...data.error_weights import Weights
from ...data.pictures import ZIP_ERRORS
from ...errors import DataError
from ...render.scene_file import read_scene, scene_of
from .scene import scene_weights

KEYS = ("pair", "texel")
LAYOUT = "pair [views, lights] and texel [height, width], or one of them, floats"


def given_weights(btf: BTF, config: WeightsConfig) -> Weights:
    """The weights of the settings, all 1 if they name none; 0 at missing pairs.

    Raises:
        ConfigError: the scene is malformed or its picture is black.
        DataError: the file is missing or holds no weights for this BTF.
    """
    weights = Weights.build(btf)
    if config.file is not None:
        weights = weights.times(weights_of_file(btf, config.file))
    if config.scene is not None:
        scene = read_scene(config.scene)
        aspect = btf.width / btf.height
        own = scene_weights(btf, scene_of(scene, aspect), scene.settings, config.scene)
        weights = weights.times(own)
    return weights.floored(config.floor)


def weights_of_file(btf: BTF, path: Path | str) -> Weights:
    """The weights in an NPZ file with `pair [V, L]`, `texel [H, W]`, or both.

    Raises:
        DataError: the file is missing or malformed, or its weights do not fit the BTF.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: torch.from_numpy(file[key]) for key in KEYS if key in file.files}
    except (*ZIP_ERRORS, OSError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"weights {path} cannot be read ({error}); expected an NPZ with {LAYOUT}; save it "
            f"with numpy.savez."
        ) from error
    if not arrays:
        raise DataError(
            f"weights {path} has neither 'pair' nor 'texel'; expected {LAYOUT}; save it with "
            f"numpy.savez under these names."
        )
    return Weights.build(btf, arrays.get("pair"), arrays.get("texel"), where=f"weights {path}")
