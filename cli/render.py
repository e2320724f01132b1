"""Render a model, or a BTF itself, on a sphere or a plane, by direct light."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from spmm_torch.config.fit import FitConfig
from spmm_torch.config.render import LIGHT_FORMS, SceneConfig, check_output
from spmm_torch.errors import ConfigError

from .inputs import add_reading, check_input, check_place, check_run, decode, reading
from .parser import Parser, add_cache, add_output, file_name, number, whole_number
from .settings import add_settings, read_settings

if TYPE_CHECKING:
    import torch

    from spmm_torch.render import Material, Rendering, Scene
    from spmm_torch.runtime.progress import Progress

MAX_FRAMES = 1000


def add_options(parser: Parser) -> None:
    """The options of `spmm render`."""
    add = parser.add_argument
    add("run", nargs="?", type=file_name, metavar="RUN", help="run folder or model file")
    add_output(parser, "OUT", "picture to make: .png, .exr (linear), or .gif of a turntable")
    add("--input", type=file_name, metavar="BTF", help="BTF to render instead of RUN")
    add_reading(parser, "that of RUN, if given: BTF is then read as its fit read it")
    add_settings(parser, SceneConfig, "shape", "repeat", "camera")
    add(
        "--light",
        dest="lights",
        action="append",
        metavar="LIGHT",
        help=f"light: {LIGHT_FORMS}; angles in degrees from +z; may be repeated (default: studio)",
    )
    add_settings(parser, SceneConfig, "size", "samples", "lighting", "light_samples")
    add(
        "--exposure",
        default="auto",
        metavar="FACTOR",
        help="factor from radiance to display values; auto: 99.9th percentile to 1 (default: auto)",
    )
    add(
        "--gamma",
        dest="display_gamma",
        type=number,
        metavar="X",
        help="display gamma of a .png or .gif (default: the sRGB curve)",
    )
    add(
        "--turntable", type=whole_number, metavar="N", help=f"frames of one turn; 2 to {MAX_FRAMES}"
    )
    add(
        "--turn",
        choices=("light", "camera"),
        default="light",
        help="what turns in a turntable (default: %(default)s)",
    )
    add_settings(parser, SceneConfig, "seed")
    add_settings(parser, FitConfig, "device")
    add_cache(parser)


def run(options: argparse.Namespace) -> list[str]:
    """Renders, and writes the output whole or not at all."""
    _check(options)
    from spmm_torch.render import render
    from spmm_torch.render.options import parse_exposure
    from spmm_torch.render.scene_file import scene_of
    from spmm_torch.runtime.device import full_precision, resolve_device
    from spmm_torch.runtime.progress import Progress

    exposure, config, progress = (
        parse_exposure(options.exposure),
        read_settings(SceneConfig, options),
        Progress(),
    )
    scene_of(config)  # what is wrong with it shows before a BTF is decoded
    device = resolve_device(options.device)
    material, aspect = load_material(options, device, progress)
    scene = scene_of(config, aspect)
    scenes = turned(scene, options.turntable, options.turn) if options.turntable else [scene]
    total = len(scenes) * config.size**2 * config.samples
    with progress.stage("render", total, "eye rays") as stage, full_precision():
        pictures = [render(material, each, config, device, progress=stage) for each in scenes]
    exposure = write_pictures(options, pictures, exposure)
    return [options.output if exposure is None else f"{options.output} (exposure {exposure:.6g})"]


def load_material(
    options: argparse.Namespace, device: torch.device, progress: Progress
) -> tuple[Material, float]:
    """What is to be rendered, on its device, and width over height of its texture."""
    from spmm_torch.data import load_input
    from spmm_torch.model.spmm import SPMM
    from spmm_torch.render import BTFMaterial
    from spmm_torch.runs.inputs import run_settings

    if options.input is None:
        model = SPMM.load(options.run, device)
        return model, model.width / model.height
    config = reading(options, run_settings(options.run) if options.run else None)
    btf = load_input(options.input, config.data, config.seed)
    decode(btf, progress, options.cache)
    return BTFMaterial.build(btf, device), btf.width / btf.height


def turned(scene: Scene, frames: int, what: str) -> list[Scene]:
    """One scene for each frame of a turn of the lights, or of the camera, about the shape."""
    from spmm_torch.render import Scene, turn

    scenes = []
    for frame in range(frames):
        rotation = turn(scene.shape.axis, 2.0 * math.pi * frame / frames)
        if what == "camera":
            scenes.append(Scene(scene.shape, scene.camera.rotated(rotation), scene.lights))
        else:
            lights = tuple(light.rotated(rotation) for light in scene.lights)
            scenes.append(Scene(scene.shape, scene.camera, lights))
    return scenes


def write_pictures(
    options: argparse.Namespace, results: list[Rendering], exposure: float | None
) -> float | None:
    """Writes the pictures; returns the exposure that was taken, None for linear ones."""
    from spmm_torch.render import auto_exposure, display_codes, write_exr, write_gif, write_png

    pictures = [result.picture for result in results]
    if options.output.lower().endswith(".exr"):
        write_exr(options.output, pictures[0])
        return None
    if exposure is None:
        exposure = auto_exposure(pictures, [result.coverage for result in results])
    codes = [display_codes(picture, exposure, options.display_gamma) for picture in pictures]
    if options.turntable is not None:
        write_gif(options.output, codes)
    else:
        write_png(options.output, codes[0])
    return exposure


def _check_effect(options: argparse.Namespace) -> None:
    """Refuses options that would change nothing: what they were meant for is something else."""
    reading = {"--config": options.config, "--set": options.set, "--pattern": options.pattern}
    given = next((name for name, value in reading.items() if value), None)
    if given is not None and options.input is None:
        raise ConfigError(
            f"{given} tells how a BTF is read, and there is none; expected --input BTF beside it; "
            f"give one, or leave {given} out."
        )
    if options.turn != "light" and options.turntable is None:
        raise ConfigError(
            f"--turn {options.turn} is that of a turntable; expected --turntable N beside it."
        )
    if options.display_gamma is not None and options.output.lower().endswith(".exr"):
        raise ConfigError(
            f"--gamma is for .png and .gif; output {options.output} is linear; leave it out."
        )


def _check(options: argparse.Namespace) -> None:
    """Refuses what cannot go on, before any work is done."""
    gamma, frames = options.display_gamma, options.turntable
    if options.run is None and options.input is None:
        raise ConfigError("nothing to render; expected RUN, or --input BTF; give one of them.")
    if gamma is not None and not (math.isfinite(gamma) and gamma > 0.0):
        raise ConfigError(f"--gamma is {gamma}; expected a positive number.")
    if frames is not None and not 2 <= frames <= MAX_FRAMES:
        raise ConfigError(f"--turntable is {frames}; expected 2 to {MAX_FRAMES} frames.")
    _check_effect(options)
    check_place(options.output, replaces=True)
    check_output(options.output, frames is not None)
    if options.input is not None:
        check_input(options.input)
    elif options.run is not None:
        check_run(options.run, f"give --input {options.run} to render a BTF itself")
