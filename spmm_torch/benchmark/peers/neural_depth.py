"""A neural BTF with parallax, in the manner of NeuMIP: a depth tells where its texture is read.

A small texture and a network give one depth for each place and view; the latent texture is read
where the ray of the view is at that depth [KMXHR21]. The authors found that a depth learns better
than a shift in two dimensions. Their pyramid of levels is left out: a BTF has one level.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ...data import BTF
from ...geometry.directions import REPEAT, texel_at
from ...geometry.relief import texel_centres
from .neural_btf import LATENT, LATENT_SIZE, NeuralBTF
from .problem import Peer, Problem, Row
from .training import trained_rows

# Numbers of a texel that tell its depth, and units of a layer of the network that reads them.
SURFACE, SURFACE_WIDTH = 4, 16
# Depth of an output of 1, in texture widths.
DEPTH = 0.1
# Least cosine of a view that shifts by depth / cosine; those that were measured are steeper.
LEAST_COSINE = 0.1
# Blur of the latent texture at first, in texels, and the fraction of the training after which there
# is none: with it depths are found that are larger than a texel, as in the paper.
BLUR, BLURRED = 3.0, 0.5


class DepthBTF(NeuralBTF):
    """Values from a latent texture that is read where each view meets the surface.

    Args:
        btf, scale, latent: as of `NeuralBTF`.
    """

    place: Tensor
    shift: Tensor
    view: Tensor
    frequency: Tensor

    def __init__(self, btf: BTF, scale: float, latent: int = LATENT) -> None:
        super().__init__(btf, scale, latent)
        self.size = (btf.height, btf.width)
        self.surface = nn.Parameter(LATENT_SIZE * torch.randn(btf.texel_count, SURFACE))
        self.depth = nn.Sequential(
            nn.Linear(SURFACE + 2, SURFACE_WIDTH),
            nn.LeakyReLU(),
            nn.Linear(SURFACE_WIDTH, SURFACE_WIDTH),
            nn.LeakyReLU(),
            nn.Linear(SURFACE_WIDTH, 1),
        )
        square = btf.view.new_tensor((1.0, btf.width / btf.height))  # texels are square
        self.register_buffer("place", texel_centres(*self.size, btf.view))  # [T, 2]
        self.register_buffer(
            "shift", btf.view[:, :2] / btf.view[:, 2:].clamp(min=LEAST_COSINE) * square
        )
        self.register_buffer("view", btf.view[:, :2])
        rows, columns = (torch.fft.fftfreq(side) for side in self.size)
        self.register_buffer("frequency", rows[:, None].square() + columns.square())

    def read(self, texel: Tensor, pair: Tensor) -> Tensor:
        """Latent vectors `[n, F]` where the view of a pair meets the surface; see `NeuralBTF`."""
        view = pair.div(self.lights, rounding_mode="floor")
        depth = self.depths(texel, view)
        at = self.place[texel] + depth * self.shift[view]
        index, weight = texel_at(at, *self.size, REPEAT)  # [n, 4]
        return F.embedding_bag(index, self._sharpened(), mode="sum", per_sample_weights=weight)

    def depths(self, texel: Tensor, view: Tensor) -> Tensor:
        """How far along their rays views `[n]` meet the surface at texels `[n]`, `[n, 1]`.

        In texture widths above the plane.
        """
        return DEPTH * self.depth(torch.cat((self.surface[texel], self.view[view]), dim=1))

    def textures(self) -> list[nn.Parameter]:
        """The latent texture, and the one of depths."""
        return [self.latent, self.surface]

    def _sharpened(self) -> Tensor:
        """The latent texture `[T, F]`, blurred as much as the training is young."""
        blur = BLUR * (1.0 - self.spent / BLURRED)
        if blur <= 0.0:
            return self.latent
        pass_ = torch.exp(-2.0 * (torch.pi * blur) ** 2 * self.frequency)[..., None]  # [H, W, 1]
        waves = torch.fft.fft2(self.latent.view(*self.size, -1), dim=(0, 1))
        return torch.fft.ifft2(waves * pass_, dim=(0, 1)).real.reshape(self.latent.shape)


def run(problem: Problem) -> list[Row]:
    """Trains for the time of our own fit, and for multiples of it."""
    return trained_rows(problem, "neural BTF with depth", DepthBTF)


PEER = Peer(
    "neural BTF with depth", "the same, read where each view meets a surface that it learns", run
)
