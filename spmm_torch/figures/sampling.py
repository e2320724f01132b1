"""Fig. 10: importance sampling, and its noise at equal time [WDR11 §6, Fig. 10]."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import direction_from_angles
from ..model.spmm import SPMM
from ..render import (
    Camera,
    CosineSampled,
    EnvironmentLight,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    auto_exposure,
    display_codes,
)
from ..render.direct import Hits
from ..render.material import SampledMaterial
from ..render.renderer import trace
from ..runtime.device import full_precision
from .comparison import REPEAT
from .figure import Drawing, Subject
from .hemisphere import glossiest_texel, intensity_picture, sample_picture, texel_centre
from .sheet import Panel, sheet
from .variance import Efficiency, gain, hits_at, repeated, shade_by_sampler, some_hits, white_light

# Samples shown as dots.
DOTS = 1500
# Directions of each hit by our sampler; the other one takes as many as fit in the same time.
OUR_SAMPLES = 16
# Hits of the sphere and directions of each that variances are taken over: enough of them to meet
# rare highlights.
VARIANCE_HITS, VARIANCE_SAMPLES = 256, 1024
SAMPLERS = ("spmm", "cosine")


def draw_sampling(subject: Subject) -> Drawing:
    """Pictures (a) to (e) of the paper's figure, and the variances behind them."""
    model, choices = subject.model, subject.choices
    wo = direction_from_angles(*torch.tensor(choices.view, dtype=torch.float64)).to(model.weight)
    texel = _texel(model, choices.texel, wo)
    uv = texel_centre(model, texel)
    with subject.progress.stage("figure10", 2, "parts") as stage, full_precision():
        top = _disks(model, uv, wo, choices.size, choices.seed)
        bottom, values = _equal_time(subject)
        stage()
        values["variance"] = _variances(subject, uv, wo)
        stage()
    column, row = texel % model.width, texel // model.width
    angles = [math.degrees(angle) for angle in choices.view]
    values |= {"texel": [column, row], "view_degrees": angles}
    return Drawing(sheet([top, bottom]), _caption(values), values)


def samplers(model: SPMM) -> dict[str, SampledMaterial]:
    """Our sampler and the conventional one of the same values, by name."""
    return dict(zip(SAMPLERS, (model, CosineSampled(model)), strict=True))


def variance_gains(
    model: SPMM, hits: Hits, light: EnvironmentLight, each: int, seed: int
) -> dict[str, Any]:
    """Variance and time of one sample by both samplers, and the factor that ours gains."""
    found: dict[str, Efficiency] = {}
    for name, material in samplers(model).items():
        shade_by_sampler(material, hits, light, 2, seed)  # warms up
        found[name] = shade_by_sampler(material, hits, light, each, seed)[1]
    gains = gain(found["spmm"], found["cosine"])
    return {**{name: asdict(each) for name, each in found.items()}, "gain": asdict(gains)}


def sphere_hits(model: SPMM, settings: RenderSettings) -> Hits:
    """Hits of the eye rays of a picture of the sphere."""
    texture = Texture(REPEAT, model.width / model.height)
    scene = Scene(Sphere(texture), Camera.orthographic(), (white_light(),))
    generator = torch.Generator().manual_seed(settings.seed)
    return trace(scene, settings, slice(0, settings.size**2), model.weight.detach(), generator)


def _texel(model: SPMM, given: tuple[int, int] | None, wo: Tensor) -> int:
    if given is None:
        return glossiest_texel(model, wo)
    x, y = given
    if not (0 <= x < model.width and 0 <= y < model.height):
        raise ConfigError(
            f"texel {x},{y} lies outside of the texture; expected x from 0 to {model.width - 1} "
            f"and y from 0 to {model.height - 1}."
        )
    return y * model.width + x


def _disks(model: SPMM, uv: Tensor, wo: Tensor, size: int, seed: int) -> list[Panel]:
    """(a) intensity, (b) our samples, (c) samples of the cosine lobe."""
    generator = torch.Generator().manual_seed(seed)
    u = torch.rand(DOTS, 3, generator=generator).to(uv)
    with torch.no_grad():
        dots = {
            name: material.sample(uv.expand(DOTS, 2), wo.expand(DOTS, 3), u)[0]
            for name, material in samplers(model).items()
        }
    return [
        Panel(intensity_picture(model, uv, wo, size), "(a) BTF intensity"),
        Panel(sample_picture(dots["spmm"], size), "(b) samples, ours"),
        Panel(sample_picture(dots["cosine"], size), "(c) samples, cosine lobe"),
    ]


def _equal_time(subject: Subject) -> tuple[list[Panel], dict[str, Any]]:
    """(d) and (e): the sphere in the studio by either sampler alone, in the same time."""
    model, choices = subject.model, subject.choices
    settings = RenderSettings(choices.size, 1, seed=choices.seed)
    hits = sphere_hits(model, settings)
    light = EnvironmentLight.studio().to(subject.device, model.weight.dtype)
    both = samplers(model)
    seconds = {}
    for name, material in both.items():
        shade_by_sampler(material, some_hits(hits, 256, choices.seed), light, 2, choices.seed)
        seconds[name] = shade_by_sampler(material, hits, light, 2, choices.seed)[1].seconds
    ratio = seconds["spmm"] / seconds["cosine"]
    counts = {"spmm": OUR_SAMPLES, "cosine": max(1, round(OUR_SAMPLES * ratio))}
    pictures, values = {}, {}
    for name, material in both.items():
        radiance, cost = shade_by_sampler(material, hits, light, counts[name], choices.seed)
        flat = torch.zeros(settings.size**2, 3, device=radiance.device).index_add_(
            0, hits.pixel, radiance
        )
        pictures[name] = flat.view(settings.size, settings.size, 3)
        spent = cost.seconds * counts[name] * len(hits)
        values[name] = {"directions_per_pixel": counts[name], "seconds": spent}
    lit = pictures["spmm"].sum(-1)
    exposure = auto_exposure([pictures["spmm"]], [lit])
    labels = {"spmm": "(d) equal time, ours", "cosine": "(e) equal time, cosine lobe"}
    panels = [
        Panel(display_codes(pictures[name], exposure), f"{labels[name]}, {counts[name]} directions")
        for name in SAMPLERS
    ]
    return panels, {"equal_time_pictures": values}


def _variances(subject: Subject, uv: Tensor, wo: Tensor) -> dict[str, Any]:
    """Variances of the sphere in the studio and in white light, and of the texel in white light."""
    model, seed = subject.model, subject.choices.seed
    settings = RenderSettings(subject.choices.size, 1, seed=seed)
    hits = some_hits(sphere_hits(model, settings), VARIANCE_HITS, seed)
    lights = {"studio": EnvironmentLight.studio(), "white": white_light()}
    placed = {name: light.to(subject.device, model.weight.dtype) for name, light in lights.items()}
    found = {
        f"sphere_{name}": variance_gains(model, hits, light, VARIANCE_SAMPLES, seed)
        for name, light in placed.items()
    }
    texel = repeated(hits_at(uv, wo), VARIANCE_HITS)
    found["texel_white"] = variance_gains(model, texel, placed["white"], VARIANCE_SAMPLES, seed)
    return found


def _caption(values: dict[str, Any]) -> str:
    (column, row), (polar, azimuth) = values["texel"], values["view_degrees"]
    times, variance = values["equal_time_pictures"], values["variance"]
    gains = {name: each["gain"] for name, each in variance.items()}
    studio, texel = gains["sphere_studio"], gains["texel_white"]
    return (
        f"Importance sampling. Top: the upper hemisphere of texel {column}, {row} seen from "
        f"{polar:g}° / {azimuth:g}°, projected onto the disk: (a) intensity, bluer where it is "
        f"higher, (b) {DOTS:,} samples by the model's own sampling, (c) as many of a cosine lobe. "
        f"Bottom: the sphere in studio light in {times['spmm']['seconds']:.2f} s by each sampler "
        f"alone: (d) ours with {times['spmm']['directions_per_pixel']} directions a pixel, (e) the "
        f"cosine lobe with {times['cosine']['directions_per_pixel']}. {_verdict(studio, texel)}"
    )


def _verdict(studio: dict[str, float], texel: dict[str, float]) -> str:
    """What sampling by the model gains on the sphere and on the texel, or that it gains nothing."""
    if studio["equal_time"] < 1.0:
        return (
            f"This material is matt: a cosine lobe does as well on the sphere. At equal sample "
            f"count its variance is {studio['equal_count']:.2f} times ours, at equal time "
            f"{studio['equal_time']:.2f} times; for the texel under light from everywhere "
            f"{texel['equal_count']:.2f} and {texel['equal_time']:.2f} times."
        )
    return (
        f"The variance of (d) is lower by a factor of {studio['equal_time']:.1f} at equal time and "
        f"{studio['equal_count']:.1f} at equal sample count; for the texel under light from "
        f"everywhere by {texel['equal_time']:.1f} and {texel['equal_count']:.1f}."
    )
