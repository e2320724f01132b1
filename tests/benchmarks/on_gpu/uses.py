"""Parts that use a model: triples, rendering, sampling, training steps."""

from __future__ import annotations

import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.render import RenderSettings, render
from tests.benchmarks.on_gpu.made_up import model
from tests.benchmarks.on_gpu.measuring import measured
from tests.benchmarks.on_gpu.rows import Put
from tests.benchmarks.on_gpu.sizes import Sizes
from tests.benchmarks.render_sphere import scene_of

STEEPEST, TURN = 1.5, 6.28


def queries(count: int, device: str) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Random uv `[count, 2]`, wi and wo `[count, 3]`, and numbers `[count, 3]`, on a device."""
    generator = torch.Generator().manual_seed(0)
    uv, u = (torch.rand(count, width, generator=generator) for width in (2, 3))
    angles = torch.rand(2, 2, count, generator=generator)
    wi, wo = (direction_from_angles(STEEPEST * theta, TURN * phi) for theta, phi in angles)
    return uv.to(device), wi.to(device), wo.to(device), u.to(device)


@torch.no_grad()
def triples(device: str, sizes: Sizes, put: Put) -> None:
    """A million (uv, wi, wo), with and without the residual."""
    there, where = model(sizes.texture).to(device), torch.device(device)
    uv, wi, wo, _ = queries(sizes.queries, device)
    for name, whole in (("lobes", False), ("with residual", True)):
        label = f"{sizes.queries:,} triples, {name}"
        work = lambda whole=whole: there(uv, wi, wo, residual=whole)  # noqa: E731
        measured(label, work, where, sizes.patience, put)


@torch.no_grad()
def rendering(device: str, sizes: Sizes, put: Put) -> None:
    """A sphere under three lights."""
    there, settings = model(sizes.texture).to(device), RenderSettings(size=sizes.picture)
    scene = scene_of(1.0)
    label = f"sphere, {sizes.picture} x {sizes.picture} pixels, {settings.samples} rays each"
    work = lambda: render(there, scene, settings, device)  # noqa: E731
    measured(label, work, torch.device(device), sizes.patience, put)


@torch.no_grad()
def sampling(device: str, sizes: Sizes, put: Put) -> None:
    """Directions drawn by the lobes, and their densities."""
    there, where = model(sizes.texture).to(device), torch.device(device)
    uv, wi, wo, u = queries(sizes.queries, device)
    count = f"{sizes.queries:,}"
    measured(f"{count} samples", lambda: there.sample(uv, wo, u), where, sizes.patience, put)
    measured(f"{count} densities", lambda: there.pdf(uv, wi, wo), where, sizes.patience, put)


def training(device: str, sizes: Sizes, put: Put) -> None:
    """Steps of Adam on all floating parameters, towards grey."""
    there, where = model(sizes.texture).to(device), torch.device(device)
    uv, wi, wo, _ = queries(sizes.batch, device)
    work = Steps(there, uv, wi, wo, sizes.steps)
    label = f"training step, {sizes.batch:,} triples"
    measured(label, work, where, sizes.patience, put, times=sizes.steps)
    losses = work.losses
    assert losses[-1] < losses[0], f"the loss went from {losses[0]} to {losses[-1]}"


class Steps:
    """Some training steps; `losses` are those of all calls so far, read once a call."""

    def __init__(self, there: SPMM, uv: Tensor, wi: Tensor, wo: Tensor, count: int) -> None:
        parameters = [part for part in there.parameters() if part.is_floating_point()]
        self.optimizer = torch.optim.Adam([part.requires_grad_() for part in parameters], lr=1e-3)
        self.there, self.queries, self.count = there, (uv, wi, wo), count
        self.losses: list[float] = []

    def __call__(self) -> None:
        """Makes the steps."""
        losses = []
        for _ in range(self.count):
            self.optimizer.zero_grad()
            loss = (self.there(*self.queries) - 0.1 * self.queries[1][:, 2:]).square().mean()
            loss.backward()
            self.optimizer.step()
            losses.append(loss.detach())
        self.losses += torch.stack(losses).tolist()
