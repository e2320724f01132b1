"""Training of neural BTFs: Adam on squared errors of random values, for a given time."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from ...data import BTF
from ..drawing import snr_of_pictures
from ..protocol import Timing, now
from .neural_btf import NeuralBTF
from .problem import WHOLE, Problem, Row, row

BATCH = 1 << 14
LEARNING_RATE, LEAST_RATE = 8e-3, 1e-2  # at first, and the fraction of it at the end

# (BTF, typical size of its values) -> a network that is not trained yet.
Build = Callable[[BTF, float], NeuralBTF]


def train(build: Build, btf: BTF, values: Tensor, seconds: float) -> tuple[NeuralBTF, int]:
    """A network trained for a time, its parameters as a file holds them, and its number of steps.

    Args:
        build: makes the network; layers draw from torch's own generator.
        btf: whose values they are.
        values: `[T, D, C]` on the device.
        seconds: of the training.
    """
    generator, device = torch.Generator().manual_seed(0), values.device
    texels, pairs, _ = values.shape
    scale = float(values.square().mean().sqrt())
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = build(btf, scale).to(device)
    optimizer = torch.optim.Adam(model.parameters(), LEARNING_RATE)
    start, steps = now(device), 0
    while (spent := (now(device) - start) / seconds) < 1.0:
        model.spent = spent
        rate = LEAST_RATE + (1.0 - LEAST_RATE) * 0.5 * (1.0 + math.cos(math.pi * spent))
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * rate
        texel = torch.randint(texels, (BATCH,), generator=generator).to(device)
        pair = torch.randint(pairs, (BATCH,), generator=generator).to(device)
        error = (model(texel, pair) - values[texel, pair]) / scale
        optimizer.zero_grad()
        error.square().mean().backward()
        optimizer.step()
        steps += 1
    model.spent = 1.0
    model.store()
    return model, steps


def trained_rows(problem: Problem, name: str, build: Build) -> list[Row]:
    """Rows of a network trained for the time of our own fit, and for multiples of it."""
    rows = []
    for factor in problem.scope.training:
        seconds = factor * problem.ours.seconds_after_load
        model, steps = train(build, problem.btf, problem.values, seconds)
        rows.append(
            row(
                f"{name}, {factor:g} x our time",
                WHOLE,
                problem.btf.texel_count,
                Timing((seconds,)),
                snr_of_pictures(problem.btf, model.of_view),
                size=model.texel_bytes + model.shared_bytes,
                note=f"{steps} Adam steps of {BATCH} values",
            )
        )
    return rows
