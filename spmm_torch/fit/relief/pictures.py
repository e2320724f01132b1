"""The pictures in which a relief is sought: few lights, all views that are steep enough."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from ...data import BTF
from ...runtime.memory import slices
from .resample import centres, resampled, within

# Cosine of the most grazing view that takes part: beyond 63 degrees most of a relief hides itself.
LEAST_VIEW_COSINE = 0.45
# Cosine of the most grazing light that is chosen where there are others: shadows have no texture.
LEAST_LIGHT_COSINE = 0.4
# Polar cosine near which the first light is chosen: it shades the relief, with few shadows.
FIRST_LIGHT_COSINE = 0.8
# Views that take part at most: more of them lower the noise of few textures.
MAX_VIEWS = 64
# Fraction of a picture's mean that is added before the logarithm, so that shadows stay finite.
LOG_FLOOR = 0.1
# Least deviation of the logarithms of a picture with texture: 8-bit codes round by about as much.
LEAST_DEVIATION = 1e-3
# Values of candidates that are held at once: on a CPU, which takes view by view, 16 MB of float32;
# on a GPU, which takes as many views as there is room for, 0.5 GB.
CHUNK_VALUES, CUDA_CHUNK_VALUES = 1 << 22, 1 << 27

# Rows and columns of a part of a picture.
Window = tuple[slice, slice]
WHOLE: Window = (slice(None), slice(None))


@dataclass(frozen=True)
class PictureStack:
    """Pictures of some views under some lights, comparable over views.

    Attributes:
        values: logarithms of grey values, of mean 0 and variance 1 in each picture, `[V, L, H, W]`.
        weight: how much each picture counts, `[V, L]`; 0: not at all.
        slope: columns and rows by which a point one texture width high moves, `[V, 2]`.
        drift: columns and rows by which each view is shifted besides, `[V, 2]`.
        repeats: whether the texture repeats beyond its border.
    """

    values: Tensor
    weight: Tensor
    slope: Tensor
    drift: Tensor
    repeats: bool = False

    @property
    def size(self) -> tuple[int, int]:
        """The number of rows and columns of the pictures."""
        return self.values.shape[2], self.values.shape[3]

    def runs(self, candidates: int = 1) -> list[slice]:
        """Consecutive views that are looked at together, for so many heights of each texel."""
        room = max(CUDA_CHUNK_VALUES // (candidates * self.values[0].numel()), 1)
        return list(slices(len(self.values), room if self.values.is_cuda else 1))

    def aligned(self, run: slice, height: Tensor, window: Window = WHOLE) -> tuple[Tensor, Tensor]:
        """What V views show of points of `height [N, H, W]`, within a window of `[h, w]` texels.

        Returns:
            (values `[V, N, L, h, w]`, weights of that shape or of one that expands to it: 0 where
            the point lies beyond the picture).
        """
        column, row = (place[window] for place in centres(*self.size, self.values.device))
        height = height[:, *window]
        # Not read, since the host would wait: [2, V, 1, 1, 1].
        slope, drift = (part[run].T[..., None, None, None] for part in (self.slope, self.drift))
        column, row = column - height * slope[0] + drift[0], row - height * slope[1] + drift[1]
        values = resampled(self.values[run], column, row, self.repeats)
        weight = self.weight[run][:, None, :, None, None]  # [V, 1, L, 1, 1]
        if self.repeats:
            return values, weight
        return values, weight * within(column, row, *self.size)[:, :, None]

    def disagreement(self, height: Tensor) -> Tensor:
        """Variance over views, mean over lights `[N, H, W]`, of points of `height [N, H, W]`.

        Pictures without any relation give 1, which stands too where less than half of the views
        show the point.
        """
        size = self.values[0].numel()
        step = max((CUDA_CHUNK_VALUES if height.is_cuda else CHUNK_VALUES) // size, 1)
        return torch.cat([self._disagreement(height[block]) for block in slices(len(height), step)])

    def _disagreement(self, height: Tensor) -> Tensor:
        total, squares, seen, seen_squares = self._sums(height)
        divisor = seen.clamp(min=torch.finfo(seen.dtype).tiny)
        # Fewer views agree by chance: the unbiased variance does not reward that.
        count = seen * divisor / seen_squares.clamp(min=torch.finfo(seen.dtype).tiny)
        variance = (squares / divisor - (total / divisor).square()).clamp(min=0.0)
        variance = variance * count / (count - 1.0).clamp(min=0.5)
        known = seen >= 0.5 * self.weight.sum(0)[:, None, None]
        lights = (self.weight.sum(0) > 0.0).to(seen.dtype)[:, None, None]
        cost = torch.where(known, variance, torch.ones_like(variance))
        return (cost * lights).sum(1) / lights.sum().clamp(min=1.0)

    def _sums(self, height: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Sums over views of values, their squares, weights, and their squares: `[N, L, H, W]`."""
        shape = (len(height), *self.values.shape[1:])
        total, squares = torch.zeros((2, *shape), device=height.device)
        seen, seen_squares = torch.zeros((2, *shape), device=height.device)
        for run in self.runs(len(height)):
            values, weight = self.aligned(run, height)
            weighted = weight * values
            if len(values) == 1:
                squares[None].addcmul_(weighted, values)
            else:
                squares += (weighted * values).sum(0)
            total += added(weighted)
            seen += added(weight)
            seen_squares += added(weight * weight)
        return total, squares, seen, seen_squares

    def reduced(self, factor: int) -> PictureStack:
        """The stack with means of about `factor` x `factor` texels in place of texels."""
        if factor <= 1:
            return self
        rows, columns = self.size
        size = (max(rows // factor, 1), max(columns // factor, 1))
        scale = torch.tensor([size[1] / columns, size[0] / rows], device=self.slope.device)
        values = functional.interpolate(self.values, size, mode="area")
        return replace(
            self,
            values=normalized(values),
            slope=self.slope * scale,
            drift=self.drift * scale,
        )

    def middle(self, side: int) -> PictureStack:
        """The stack of the middle `side` x `side` texels; itself if it has no more."""
        rows, columns = self.size
        if max(rows, columns) <= side:
            return self
        top, left = max(rows - side, 0) // 2, max(columns - side, 0) // 2
        values = self.values[:, :, top : top + side, left : left + side]
        return replace(self, values=normalized(values), repeats=False)

    def turned(self) -> PictureStack:
        """The stack as if all views were turned by a quarter about the normal."""
        column, row = self.slope.unbind(1)
        return replace(self, slope=torch.stack((-row, column), dim=1))

    def part(self, views: Tensor | None = None, lights: Tensor | None = None) -> PictureStack:
        """The stack of some of its views, indices `[V']`, and lights, indices `[L']`."""
        every_view = torch.arange(len(self.values)) if views is None else views
        every_light = torch.arange(self.values.shape[1]) if lights is None else lights
        return replace(
            self,
            values=self.values[every_view][:, every_light],
            weight=self.weight[every_view][:, every_light],
            slope=self.slope[every_view],
            drift=self.drift[every_view],
        )


def added(parts: Tensor) -> Tensor:
    """The sum over views of `parts [V, ...]`; that of one is not copied."""
    return parts[0] if len(parts) == 1 else parts.sum(0)


def normalized(values: Tensor) -> Tensor:
    """Pictures `[..., H, W]` moved and scaled to mean 0 and variance 1; flat ones become 0."""
    centred = values - values.mean((-2, -1), keepdim=True)
    deviation = centred.square().mean((-2, -1), keepdim=True).sqrt()
    return torch.where(deviation > LEAST_DEVIATION, centred / deviation.clamp(min=1e-12), 0.0)


def read_stack(
    btf: BTF, views: Tensor, lights: Tensor, device: torch.device | str = "cpu"
) -> PictureStack:
    """The pictures of some views, indices `[V']`, under some lights, indices `[L']`.

    No others are decoded, and one view at a time is expanded.

    Raises:
        DataError: a picture cannot be decoded, or all of these pairs are missing.
        OutputError: the decoded values cannot be kept on disk.
    """
    part = btf.restricted(views=views, lights=lights)
    grey = torch.stack([part.pictures(view).mean(-1) for view in range(len(views))]).to(device)
    values = normalized(torch.cat([logarithms(some) for some in grey.split(_at_once(grey))]))
    cosine = part.view[:, 2].to(device)
    textured = values.flatten(2).any(2)  # [V', L']
    if part.missing is not None:
        textured &= ~part.missing.to(device)
    slope = shift_of_height(part.view).to(device) * btf.width
    return PictureStack(values, cosine.square()[:, None] * textured, slope, torch.zeros_like(slope))


def _at_once(pictures: Tensor) -> int:
    """Views of `pictures [V, ...]` that a device takes at once."""
    return len(pictures) if pictures.is_cuda else 1


def logarithms(pictures: Tensor) -> Tensor:
    """Logarithms of grey `pictures [..., H, W]`, each with a floor in proportion to its mean."""
    positive = pictures.clamp(min=0.0)
    floor = LOG_FLOOR * positive.mean((-2, -1), keepdim=True)
    return (positive + floor.clamp(min=torch.finfo(floor.dtype).tiny)).log()


def shift_of_height(view: Tensor) -> Tensor:
    """Columns and rows, in texture widths, by which `view [V, 3]` moves unit height, `[V, 2]`."""
    return torch.stack((view[:, 0], -view[:, 1]), dim=1) / view[:, 2:]


def chosen_views(btf: BTF) -> Tensor:
    """Indices `[V']` of the views that take part, ascending: steep ones, spread over all."""
    steep = torch.nonzero(btf.view[:, 2] > LEAST_VIEW_COSINE).flatten()
    if len(steep) <= MAX_VIEWS:
        return steep
    first = int(btf.view[steep, 2].argmax())
    return steep[spread(btf.view[steep], MAX_VIEWS, first)].sort().values


def chosen_lights(btf: BTF, count: int) -> Tensor:
    """Indices `[L']` of at most `count` lights, each far from those before it."""
    height = btf.light[:, 2]
    high = torch.nonzero(height > LEAST_LIGHT_COSINE).flatten()
    high = torch.arange(len(height)) if len(high) < 2 else high
    first = int((height[high] - FIRST_LIGHT_COSINE).abs().argmin())
    return high[spread(btf.light[high], min(count, len(high)), first)]


def spread(directions: Tensor, count: int, first: int) -> Tensor:
    """Indices `[count]` of `directions [N, 3]`, on the CPU, each the farthest from all before."""
    chosen, directions = [first], directions.cpu()  # the host reads each choice
    distance = torch.full((len(directions),), float("inf"))
    for _ in range(count - 1):
        distance = torch.minimum(distance, (directions - directions[chosen[-1]]).norm(dim=1))
        chosen.append(int(distance.argmax()))
    return torch.tensor(chosen)
