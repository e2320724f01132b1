"""The command `spmm render`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import torch

from spmm_torch.cli.parser import Parser
from spmm_torch.data import load_btf
from spmm_torch.data.options import NEGATIVES
from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.model.spmm import SPMM
from spmm_torch.render.btf_material import BTFMaterial
from spmm_torch.render.camera import turn
from spmm_torch.render.display import (
    auto_exposure,
    check_output,
    display_codes,
    write_exr,
    write_gif,
    write_png,
)
from spmm_torch.render.material import Material
from spmm_torch.render.options import (
    CAMERA_FORMS,
    LIGHT_FORMS,
    parse_camera,
    parse_exposure,
    parse_light,
)
from spmm_torch.render.renderer import Rendering, RenderSettings, Scene, render
from spmm_torch.render.shapes import SHAPES, Texture
from spmm_torch.runtime.device import full_precision, resolve_device
from spmm_torch.runtime.memory import DEFAULT_SHARE, free_memory
from spmm_torch.runtime.progress import Progress

# Repeats of the texture that show its texels and its structure alike at the default size.
REPEAT = 2.0
TURNING = ("light", "camera")
MAX_FRAMES = 1000


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm render`; returns the exit code."""
    try:
        options = parser().parse_args(arguments)
        exposure = render_files(options, Progress())
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    shown = "" if exposure is None else f" (exposure {exposure:.6g})"
    print(f"{options.output}{shown}")
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm render`."""
    settings = RenderSettings()
    result = Parser(prog="spmm render", description="Render a model, or a BTF, on a shape.")
    add = result.add_argument
    add("run", nargs="?", metavar="RUN", help="run folder or model file")
    add("-o", "--output", required=True, metavar="OUT", help=".png, .exr, or .gif of a turntable")
    add("--input", metavar="BTF", help="render this BTF itself instead of RUN")
    add(
        "--negative",
        choices=NEGATIVES,
        default="refuse",
        help="values of that BTF below zero: refuse, clip to zero, or keep (default: %(default)s)",
    )
    add("--shape", default="sphere", help=f"{' or '.join(SHAPES)} (default: sphere)")
    add("--repeat", type=float, default=REPEAT, help="copies of the texture across (default: 2)")
    add("--camera", default="orthographic", help=f"{CAMERA_FORMS}; degrees, from +z")
    add(
        "--light",
        action="append",
        metavar="LIGHT",
        help=f"repeatable: {LIGHT_FORMS}; degrees, from +z (default: studio)",
    )
    add("--size", type=int, default=settings.size, help="pixels each way (default: %(default)s)")
    add("--samples", type=int, default=settings.samples, help="eye rays (default: %(default)s)")
    add(
        "--light-samples",
        type=int,
        default=settings.light_samples,
        help="directions to an environment for each eye ray, and as many by the material "
        "(default: %(default)s)",
    )
    add("--exposure", default="auto", help="factor, or auto: nearly nothing clips (default: auto)")
    add("--gamma", type=float, help="display exponent (default: the sRGB curve)")
    add("--turntable", type=int, metavar="N", help="N frames of one turn")
    add("--turn", default="light", help=f"what turns: {' or '.join(TURNING)} (default: light)")
    add("--seed", type=int, default=settings.seed, help="of every random choice")
    add("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    add("--cache", metavar="FOLDER", help="keep decoded values of BTF here, for later calls too")
    return result


def render_files(options: argparse.Namespace, progress: Progress) -> float | None:
    """Renders as the command line asks, and writes the output whole or not at all.

    Returns:
        The exposure; None where the output is linear.
    """
    _check(options)
    exposure = parse_exposure(options.exposure)
    camera = parse_camera(options.camera)
    lights = tuple(parse_light(text) for text in options.light or ["studio"])
    settings = RenderSettings(options.size, options.samples, options.light_samples, options.seed)
    Scene(SHAPES[options.shape](Texture(options.repeat)), camera, lights)  # what is wrong, at once
    device = resolve_device(options.device)
    material, aspect = load_material(options, device, progress)
    scene = Scene(SHAPES[options.shape](Texture(options.repeat, aspect)), camera, lights)
    scenes = turned(scene, options.turntable, options.turn) if options.turntable else [scene]
    total = len(scenes) * settings.size**2 * settings.samples
    with progress.stage("render", total, "eye rays") as stage, full_precision():
        pictures = [render(material, each, settings, device, progress=stage) for each in scenes]
    return _write(options, pictures, exposure)


def load_material(
    options: argparse.Namespace, device: torch.device, progress: Progress
) -> tuple[Material, float]:
    """What is to be rendered, on its device, and width over height of its texture."""
    if options.input is None:
        model = SPMM.load(options.run, device)
        return model, model.width / model.height
    btf = load_btf(options.input, negative=options.negative)
    cache = Path(options.cache) if options.cache else None
    with progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=int(DEFAULT_SHARE * free_memory()), cache=cache)
    return BTFMaterial.build(btf, device), btf.width / btf.height


def turned(scene: Scene, frames: int, what: str) -> list[Scene]:
    """One scene for each frame of a turn of the lights, or of the camera, about the shape."""
    scenes = []
    for frame in range(frames):
        rotation = turn(scene.shape.axis, 2.0 * math.pi * frame / frames)
        if what == "camera":
            scenes.append(Scene(scene.shape, scene.camera.rotated(rotation), scene.lights))
        else:
            lights = tuple(light.rotated(rotation) for light in scene.lights)
            scenes.append(Scene(scene.shape, scene.camera, lights))
    return scenes


def _check(options: argparse.Namespace) -> None:
    """Refuse what cannot go on, before any work is done."""
    if options.run is None and options.input is None:
        raise ConfigError("nothing to render; expected RUN, or --input BTF; give one of them.")
    for name, known in (("shape", tuple(SHAPES)), ("turn", TURNING)):
        value = getattr(options, name)
        if value not in known:
            raise ConfigError(f"--{name} is {value!r}; expected {' or '.join(known)}.")
    if options.gamma is not None and not (math.isfinite(options.gamma) and options.gamma > 0.0):
        raise ConfigError(f"--gamma is {options.gamma}; expected a positive number.")
    if options.turntable is not None and not 2 <= options.turntable <= MAX_FRAMES:
        raise ConfigError(f"--turntable is {options.turntable}; expected 2 to {MAX_FRAMES} frames.")
    check_output(options.output, options.turntable is not None)


def _write(
    options: argparse.Namespace, results: list[Rendering], exposure: float | None
) -> float | None:
    """Writes the pictures; returns the exposure that was taken, None for linear ones."""
    pictures = [result.picture for result in results]
    if options.output.lower().endswith(".exr"):
        write_exr(options.output, pictures[0])
        return None
    if exposure is None:
        exposure = auto_exposure(pictures, [result.coverage for result in results])
    codes = [display_codes(picture, exposure, options.gamma) for picture in pictures]
    if options.turntable is not None:
        write_gif(options.output, codes)
    else:
        write_png(options.output, codes[0])
    return exposure
