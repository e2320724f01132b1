"""Fits the surface of each texel to how its lobes look, over many pairs of light and view.

The error is that of display values, in which highlights count as much as they are seen; what a
texel reflects in all is held by a term of its own. Directions are those of a lit, seen surface, and
as many more around mirrored ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.directions import frame_from_normal
from ...geometry.warp import square_to_cosine_hemisphere, square_to_power_cosine
from ...model.spmm import SPMM
from ...runtime.memory import slices
from ...runtime.progress import Progress
from ...solvers.adam import minimize_adam
from .angles import LEAST_COSINE
from .parameters import Parameter, Surface, Values, joined, split, start_of

# Pairs of directions of each of three kinds, and the powers of the cosine by which lights spread
# about the normal, half vectors about it, and lights about the view.
PAIRS, POWERS = (80, 40, 24), (1.0, 12.0, 50.0)
# Display values are (x / white + FOOT)^POWER, white being this quantile of all values.
POWER, FOOT, WHITE = 1.0 / 2.4, 0.003, 0.99
# Share of the light that all but the brightest texels may reflect: colours end at 1.
MAX_ALBEDO = 0.8
ENERGY_WEIGHT = 0.1  # of the error of the mean value, in the same units
# Texels that decide which layers pay, and what a layer must take away of the error.
PILOT, PAYS = 128, 0.02
STEPS, RATE, LAST_RATE = 100, 0.04, 0.008
BLOCK = 512  # texels that are fit at once: few MB, which the caches of a CPU hold
SEED = 19


@dataclass(frozen=True)
class Look:
    """What texels look like.

    Attributes:
        wi, wo: pairs of unit directions, `[3, S]`.
        value: cosine-weighted RGB, not below 0, `[T, S, 3]`, over `gain`.
        white: value that a display shows as white.
        gain: 1, or how much brighter texels are than surfaces can be: they reflect more light than
            they get, where the pictures were never calibrated.
    """

    wi: Tensor
    wo: Tensor
    value: Tensor
    white: float
    gain: float

    def of(self, texels: Tensor | slice) -> Look:
        """The look of some texels."""
        return Look(self.wi, self.wo, self.value[texels], self.white, self.gain)


@dataclass(frozen=True)
class Fitted:
    """Surfaces of T texels.

    Attributes:
        values: parameters by name, `[T, n]` each.
        layers: names of the layers that pay.
        error: of each texel, in squared display values, `[T]`.
    """

    values: dict[str, Tensor]
    layers: tuple[str, ...]
    error: Tensor


def random_pairs(like: Tensor) -> tuple[Tensor, Tensor]:
    """wi and wo `[3, S]` of three kinds.

    Lights of a cosine distribution, lights mirrored about half vectors near the normal, and lights
    near the view. Views have a cosine distribution.
    """
    points = torch.quasirandom.SobolEngine(4, scramble=True, seed=SEED).draw(sum(PAIRS)).to(like)
    wo = square_to_cosine_hemisphere(points[:, :2])
    free, half, near = (
        square_to_power_cosine(part, torch.full_like(part[:, 0], power))
        for part, power in zip(points[:, 2:].split(PAIRS), POWERS, strict=True)
    )
    seen, behind = wo.split(PAIRS)[1:]
    mirrored = 2.0 * (half * seen).sum(-1, keepdim=True) * half - seen
    frames = frame_from_normal(behind, torch.zeros_like(behind[:, 0]))
    back = (near[:, None] @ frames).squeeze(1)
    wi = torch.cat((free, mirrored, back))
    over = wi[:, 2] > LEAST_COSINE
    return wi[over].T.contiguous(), wo[over].T.contiguous()


@torch.no_grad()
def look_of(model: SPMM) -> Look:
    """The look of each texel by itself, of a model without a relief."""
    wi, wo = random_pairs(model.weight.detach())
    pictures = [model.picture(a, b).flatten(0, 1) for a, b in zip(wi.T, wo.T, strict=True)]
    value = torch.stack(pictures, dim=1).clamp(min=0.0)  # [T, S, 3]
    albedo = torch.pi * (value / wi[2, :, None])[:, : PAIRS[0]].mean(1)  # [T, 3]
    gain = max(1.0, _quantile(albedo) / MAX_ALBEDO)
    white = max(_quantile(value) / gain, torch.finfo(value.dtype).tiny)
    return Look(wi, wo, value / gain, white, gain)


def _quantile(values: Tensor) -> float:
    """What all but a few of some values `[...]` are below."""
    return float(values.flatten().kthvalue(max(1, int(WHITE * values.numel()))).values)


def gain_note(gain: float) -> tuple[str, ...]:
    """What to say of a gain: nothing of 1."""
    if gain == 1.0:
        return ()
    return (
        f"brightness: the model reflects more light than it gets, as its pictures were never "
        f"calibrated; the material is {gain:.3g} times darker, and compared as if it were not",
    )


def fit_surface(surface: Surface, look: Look, progress: Progress) -> Fitted:
    """Surfaces of all texels, with the layers that pay on some of them."""
    count = len(look.value)
    stride = max(1, count // PILOT)
    pilot = look.of(torch.arange(0, count, stride, device=look.value.device)[:PILOT])
    with progress.stage("fit", count, "texels") as stage:
        layers, typical = _layers_that_pay(surface, pilot)
        parameters = parameters_of(surface, layers)
        parts = []
        for part in slices(count, BLOCK):
            start = typical | first_colours(look.of(part))
            parts.append(fit_parameters(surface, parameters, look.of(part), start, STEPS))
            stage(len(parts[-1][1]))
    names = [each.name for each in parameters]
    values = {name: torch.cat([each[0][name] for each in parts]) for name in names}
    return Fitted(values, layers, torch.cat([each[1] for each in parts]))


def parameters_of(surface: Surface, layers: tuple[str, ...]) -> tuple[Parameter, ...]:
    """The parameters of the core and of some layers."""
    return (*surface.core, *(each for layer in layers for each in surface.layers[layer]))


def _layers_that_pay(surface: Surface, pilot: Look) -> tuple[tuple[str, ...], dict[str, Tensor]]:
    """Layers that take a share of the error away, and the medians `[1, n]` of all parameters."""
    chosen: tuple[str, ...] = ()
    start = start_of(surface.core, len(pilot.value), pilot.value) | first_colours(pilot)
    values, error = fit_parameters(surface, surface.core, pilot, start, STEPS)
    for layer, added in surface.layers.items():
        start = values | start_of(added, len(pilot.value), pilot.value)
        parameters = parameters_of(surface, (*chosen, layer))
        tried, less = fit_parameters(surface, parameters, pilot, start, STEPS)
        if float(less.mean()) < (1.0 - PAYS) * float(error.mean()):
            chosen, values, error = (*chosen, layer), tried, less
    return chosen, {name: each.median(0, keepdim=True).values for name, each in values.items()}


def first_colours(look: Look) -> dict[str, Tensor]:
    """Diffuse colours `[T, 3]` to start from: what is seen where no highlight is."""
    albedo = torch.pi * look.value / look.wi[2, :, None].clamp(min=0.1)
    return {"base_color": albedo.median(1).values.clamp(0.001, 0.9)}


def fit_parameters(
    surface: Surface,
    parameters: tuple[Parameter, ...],
    look: Look,
    start: Mapping[str, Tensor],
    steps: int,
) -> tuple[dict[str, Tensor], Tensor]:
    """The best parameters of texels, and their errors.

    Args:
        surface: the parametrization.
        parameters: what is fit.
        look: of T texels.
        start: parameters by name, `[T, n]` or `[1, n]`.
        steps: gradient steps, of which the last third are short.

    Returns:
        (parameters by name `[T, n]`, errors `[T]`).
    """
    count = len(look.value)
    target = shown(look.value, look.white)
    mean = shown(look.value.mean(1), look.white)

    def objective(units: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            free = units.detach().requires_grad_()
            error = _errors(surface, split(free, parameters), look, target, mean)
            (gradient,) = torch.autograd.grad(error.sum(), free)
        return error.detach(), gradient

    units = joined({name: each.expand(count, -1) for name, each in start.items()}, parameters)
    last = steps // 3
    for number, rate in ((steps - last, RATE), (last, LAST_RATE)):
        found = minimize_adam(objective, units, _unit, steps=number, learning_rate=rate)
        units = found.x
    return split(units, parameters), found.value


def _errors(surface: Surface, values: Values, look: Look, target: Tensor, mean: Tensor) -> Tensor:
    """Mean squared differences of display values `[T]`, and of the mean value's."""
    value = surface.eval(values, look.wi, look.wo)
    error = (shown(value, look.white) - target).square().mean((1, 2))
    energy = (shown(value.mean(1), look.white) - mean).square().mean(1)
    return error + ENERGY_WEIGHT * energy


def shown(value: Tensor, white: float) -> Tensor:
    """Display values of linear ones `[...]`; not clipped, so that brighter is still an error."""
    return (value / white + FOOT).pow(POWER)


def _unit(units: Tensor) -> Tensor:
    """The nearest numbers in 0..1; powers of parameters have no gradient at 0."""
    return units.clamp(1e-4, 1.0)
