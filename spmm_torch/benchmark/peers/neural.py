"""A small neural BTF: a latent vector for each texel, and one network that decodes it.

The plain form of neural textures [Rainer et al. 2019; Kuznetsov et al. 2021], without parallax
modules: trained by Adam on squared errors of random values, for a given time.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from ...geometry.directions import direction_pairs
from ..protocol import Timing, now
from .problem import HALF_BYTES, WHOLE, Peer, Problem, Row, row, snr_of

LATENT, WIDTH = 12, 48
BATCH = 1 << 14
LEARNING_RATE, LEAST_RATE = 8e-3, 1e-2  # at first, and the fraction of it at the end
EVALUATED = 1 << 18  # values at once, to bound the memory


class NeuralBTF(nn.Module):
    """Values from a latent texture and directions.

    Args:
        texels: T.
        features: inputs of the network for each direction pair, `[D, F]`.
        channels: C.
        scale: typical size of a value, so that outputs of the network are about 1.
    """

    features: Tensor

    def __init__(self, texels: int, features: Tensor, channels: int, scale: float) -> None:
        super().__init__()
        self.latent = nn.Parameter(0.1 * torch.randn(texels, LATENT))
        self.register_buffer("features", features)
        self.scale = scale
        self.network = nn.Sequential(
            nn.Linear(LATENT + features.shape[1], WIDTH),
            nn.LeakyReLU(),
            nn.Linear(WIDTH, WIDTH),
            nn.LeakyReLU(),
            nn.Linear(WIDTH, channels),
        )

    def forward(self, texel: Tensor, pair: Tensor) -> Tensor:
        """Values `[n, C]` of texels `[n]` and direction pairs `[n]`."""
        read = torch.cat((self.latent[texel], self.features[pair]), dim=1)
        return self.scale * self.network(read)

    def byte_count(self) -> int:
        """Bytes of all parameters in float16."""
        return HALF_BYTES * sum(part.numel() for part in self.parameters())


def direction_features(light: Tensor, view: Tensor) -> Tensor:
    """Inputs for each direction pair, `[D, 8]`, of lights `[L, 3]` and views `[V, 3]`."""
    wi, wo = direction_pairs(light, view)
    half = nn.functional.normalize(wi + wo, dim=1)
    aligned = (wi * half).sum(1, keepdim=True)
    return torch.cat((wi[:, :2], wo[:, :2], half[:, :2], aligned, wi[:, 2:]), dim=1)


def trained(problem: Problem, seconds: float) -> tuple[NeuralBTF, int]:
    """A network trained for a time, and its number of steps."""
    generator = torch.Generator().manual_seed(0)
    values, device = problem.values, problem.device
    features = direction_features(problem.btf.light, problem.btf.view).to(device)
    texels, pairs, channels = values.shape
    with torch.random.fork_rng(devices=[]):  # layers draw from the global generator
        torch.manual_seed(0)
        scale = float(values.square().mean().sqrt())
        model = NeuralBTF(texels, features, channels, scale).to(device)
    optimizer = torch.optim.Adam(model.parameters(), LEARNING_RATE)
    start, steps = now(device), 0
    while (spent := (now(device) - start) / seconds) < 1.0:
        rate = LEAST_RATE + (1.0 - LEAST_RATE) * 0.5 * (1.0 + math.cos(math.pi * spent))
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * rate
        texel = torch.randint(texels, (BATCH,), generator=generator).to(device)
        pair = torch.randint(pairs, (BATCH,), generator=generator).to(device)
        error = (model(texel, pair) - values[texel, pair]) / scale
        optimizer.zero_grad()
        error.square().mean().backward()
        optimizer.step()
        steps += 1
    return model, steps


@torch.no_grad()
def all_values(model: NeuralBTF, shape: torch.Size) -> Tensor:
    """All values `[T, D, C]` of the network with its parameters in float16."""
    for part in model.parameters():
        part.copy_(part.half().float())
    texels, pairs, _ = shape
    device = model.latent.device
    every = torch.arange(pairs, device=device)
    block = max(1, EVALUATED // pairs)
    parts = []
    for texel in torch.arange(texels, device=device).split(block):
        index = texel.repeat_interleave(pairs), every.repeat(len(texel))
        parts.append(model(*index).view(len(texel), pairs, -1))
    return torch.cat(parts)


def run(problem: Problem) -> list[Row]:
    """Trains for the time of our own fit, and for multiples of it."""
    rows = []
    for factor in problem.scope.training:
        seconds = factor * problem.ours.seconds_after_load
        model, steps = trained(problem, seconds)
        rows.append(
            row(
                f"neural BTF, {factor:g} x our time",
                WHOLE,
                problem.btf.texel_count,
                Timing((seconds,)),
                snr_of(problem.values, all_values(model, problem.values.shape)),
                size=model.byte_count(),
                note=f"{steps} Adam steps of {BATCH} values",
            )
        )
    return rows


PEER = Peer("neural BTF", "a latent texture and a small network, trained for a given time", run)
