"""From maps to a BTF file: all direction pairs are rendered, scaled and written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..config.synthesis import SynthesisSettings
from ..data import BTF
from ..data.codes import MemoryCodes
from ..data.expansion import FloatExpansion
from ..data.percentile import percentile
from ..data.store import CodeStore, check_not_black
from ..errors import ConfigError
from ..geometry.directions import UBO2003_RINGS, UBO2014_RINGS, ring_directions
from ..runtime.progress import Progress, Stage
from .maps import TextureMaps
from .target import FLOAT_BYTES, hidden_folder, target_of
from .tracer import PathTracer, picture_size
from .variant import load_mitsuba

# Fraction of the values that an 8-bit target does not clip; the highlights would darken all else.
KEPT_FRACTION = 0.998
HALF_BYTES = 2
PICTURES_FILE = "pictures.f32"
# Directions of UBO2003 and UBO2014, by their number.
RINGS = {81: UBO2003_RINGS, 151: UBO2014_RINGS}


def synthesize_btf(
    maps: TextureMaps,
    output: Path | str,
    settings: SynthesisSettings | None = None,
    progress: Progress | None = None,
) -> Path:
    """Path-traces a BTF from texture maps and writes it; returns its path.

    Pictures are kept in a hidden folder beside the output, which is always removed in the end.

    Args:
        maps: texture maps.
        output: new file or folder, whose suffix is that of the format.
        settings: settings of the synthesis; None: the defaults.
        progress: receiver of the progress; None: silent.

    Raises:
        ConfigError: Mitsuba is not installed, or a setting does not work on this machine.
        OutputError: the output exists or cannot be written.
        DataError: the BTF is all black.
    """
    settings = settings or SynthesisSettings()
    progress = progress or Progress(enabled=False)
    path = Path(output)
    target = target_of(path, settings.gamma)
    directions = ring_directions(RINGS[settings.directions])
    if maps.normal_is_upside_down():
        progress.say(
            "The normal map contradicts the height map from top to bottom: it seems to be in "
            "DirectX style; expected OpenGL style; invert its green channel."
        )
    rows, columns = picture_size(maps, settings)
    value_count = len(directions) ** 2 * rows * columns * 3
    with hidden_folder(path, value_count * (FLOAT_BYTES + target.bytes_per_value)) as folder:
        pictures = path_trace(maps, directions, directions, settings, Path(folder), progress)
        scaled = not target.hdr and settings.scale == "auto"
        scale = display_scale(pictures) if scaled else 1.0
        if not target.hdr:
            progress.say(to_display(pictures, scale))
        btf = as_btf(pictures, directions, directions, path.stem, target.hdr)
        with progress.stage("write", len(directions), "views") as stage:
            target.write(path, btf, progress=stage.to)
    return path


def path_trace(
    maps: TextureMaps,
    view: Tensor,
    light: Tensor,
    settings: SynthesisSettings,
    folder: Path,
    progress: Progress,
) -> np.ndarray:
    """Radiance `[V, L, H, W, 3]` float32 for all pairs of `view [V, 3]` and `light [L, 3]`.

    The result is a memory-mapped file in `folder`.

    Raises:
        ConfigError: Mitsuba is not installed, or a direction is not above the plane.
        DataError: the BTF is all black.
    """
    lowest = float(torch.cat((view, light))[:, 2].min())
    if lowest <= 0.0:
        raise ConfigError("a direction lies in or under the plane z = 0; expected z above 0.")
    mitsuba = load_mitsuba(settings.variant, settings.threads, progress)
    with progress.stage("build"):
        tracer = PathTracer(mitsuba, maps, settings, lowest)
    shape = (len(view), len(light), *picture_size(maps, settings), 3)
    pictures = np.memmap(folder / PICTURES_FILE, dtype=np.float32, mode="w+", shape=shape)
    with progress.stage("render", len(view), "views") as stage:
        _render(
            tracer, view.double().numpy(), light.double().numpy(), settings.seed, pictures, stage
        )
    check_not_black(float(pictures.max()), "the synthesized BTF")
    return pictures


def _render(
    tracer: PathTracer,
    views: np.ndarray,
    lights: np.ndarray,
    seed: int,
    pictures: np.ndarray,
    stage: Stage,
) -> None:
    """Renders `pictures [V, L, H, W, 3]`, each with its own seed."""
    seeds = np.random.SeedSequence(seed).generate_state(len(views) * len(lights))
    seeds = seeds.reshape(len(views), len(lights))
    for index, view in enumerate(views):
        camera = tracer.camera(view)
        for number, light in enumerate(lights):
            pictures[index, number] = tracer.picture(camera, light, int(seeds[index, number]))
        stage()


def display_scale(pictures: np.ndarray) -> float:
    """The value of `pictures [V, L, H, W, 3]` that 1 stands for.

    It is the 99.8th percentile, or the maximum if that is zero.
    """
    views = map(torch.from_numpy, pictures)
    return percentile(views, pictures.size, KEPT_FRACTION) or float(pictures.max())


def to_display(pictures: np.ndarray, scale: float) -> str:
    """Divides `pictures [V, L, H, W, 3]` by a scale and clips them at 1, in place.

    Returns:
        a line with the scale and the number of clipped values.
    """
    clipped = 0
    for view in pictures:  # [L, H, W, 3]
        view /= scale
        clipped += int(np.count_nonzero(view > 1.0))
        np.minimum(view, 1.0, out=view)
    percentage = 100.0 * clipped / pictures.size
    return (
        f"scale: 1 stands for {scale:.6g} /sr; {clipped} of {pictures.size} values "
        f"({percentage:.2g} %) lay above 1 and were clipped."
    )


def as_btf(pictures: np.ndarray, view: Tensor, light: Tensor, name: str, hdr: bool) -> BTF:
    """A BTF that shares the memory of its pictures.

    Args:
        pictures: radiance `[V, L, H, W, 3]`.
        view, light: unit vectors `[V, 3]`, `[L, 3]`.
        name: short name of the material.
        hdr: whether values may exceed 1.
    """
    view_count, light_count, height, width, channels = pictures.shape
    flat = torch.from_numpy(pictures).view(view_count * light_count, height * width, channels)
    codes = MemoryCodes(flat.transpose(0, 1))  # [T, D, C]
    store = CodeStore(codes, FloatExpansion(), float(pictures.max()))
    return BTF(
        name=name,
        path="",
        height=height,
        width=width,
        view=view,
        light=light,
        bytes_per_value=HALF_BYTES if hdr else 1,  # writers widen it where a value needs more
        open_store=lambda part, loading: store,
        hdr=hdr,
    )
