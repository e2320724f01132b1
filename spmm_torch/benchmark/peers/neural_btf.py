"""A small neural BTF: a latent vector for each texel, and one network that decodes it.

The plain form of neural textures [RJGW19, KMXHR21], without parallax.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ...data import BTF
from ...geometry.directions import direction_pairs
from ...model.components import decode_coefficients, encode_coefficients
from .problem import HALF, HALF_BYTES

LATENT, WIDTH = 12, 48
# Latent values at first: small, so that the network starts from the mean.
LATENT_SIZE = 0.1
EVALUATED = 1 << 18  # values at once, to bound the memory
SCALE_BYTES = 4


class NeuralBTF(nn.Module):
    """Values from a latent texture and directions.

    Args:
        btf: whose texels and directions they are.
        scale: typical size of a value, so that outputs of the network are about 1.
        latent: numbers of a texel, F.
    """

    features: Tensor

    def __init__(self, btf: BTF, scale: float, latent: int = LATENT) -> None:
        super().__init__()
        self.scale, self.lights = scale, len(btf.light)
        self.latent = nn.Parameter(LATENT_SIZE * torch.randn(btf.texel_count, latent))
        self.register_buffer("features", direction_features(btf.light, btf.view))
        self.network = nn.Sequential(
            nn.Linear(latent + self.features.shape[1], WIDTH),
            nn.LeakyReLU(),
            nn.Linear(WIDTH, WIDTH),
            nn.LeakyReLU(),
            nn.Linear(WIDTH, btf.channels),
        )
        self.spent = 0.0  # fraction of the training that is over

    def forward(self, texel: Tensor, pair: Tensor) -> Tensor:
        """Values `[n, C]` of texels `[n]` and direction pairs `[n]`."""
        read = torch.cat((self.read(texel, pair), self.features[pair]), dim=1)
        return self.scale * self.network(read)

    def read(self, texel: Tensor, pair: Tensor) -> Tensor:
        """Latent vectors `[n, F]` of texels `[n]` as the views of pairs `[n]` see them."""
        return self.latent[texel]

    def textures(self) -> list[nn.Parameter]:
        """What is stored for each texel, `[T, F]` each."""
        return [self.latent]

    @torch.no_grad()
    def store(self) -> None:
        """Rounds textures to a signed byte a number, as ours are, and networks to float16."""
        textures = self.textures()
        for texture in textures:
            texture.copy_(decode_coefficients(*encode_coefficients(texture)))
        for part in self._shared():
            part.copy_(part.to(HALF).float())

    @property
    def texel_bytes(self) -> int:
        """Bytes of the textures."""
        return sum(texture.numel() for texture in self.textures())

    @property
    def shared_bytes(self) -> int:
        """Bytes of networks, and of the scales of textures."""
        scales = sum(texture.shape[1] for texture in self.textures())
        return SCALE_BYTES * scales + HALF_BYTES * sum(part.numel() for part in self._shared())

    @torch.no_grad()
    def of_view(self, view: int) -> Tensor:
        """Values `[T, L, C]` under a view."""
        every = torch.arange(len(self.latent), device=self.latent.device)
        pairs = view * self.lights + torch.arange(self.lights, device=every.device)
        parts = []
        for texel in every.split(max(1, EVALUATED // self.lights)):
            index = texel.repeat_interleave(self.lights), pairs.repeat(len(texel))
            parts.append(self(*index).view(len(texel), self.lights, -1))
        return torch.cat(parts)

    def _shared(self) -> list[nn.Parameter]:
        """Parameters of networks."""
        own = {id(texture) for texture in self.textures()}
        return [part for part in self.parameters() if id(part) not in own]


def direction_features(light: Tensor, view: Tensor) -> Tensor:
    """Inputs for each direction pair, `[D, 8]`, of lights `[L, 3]` and views `[V, 3]`."""
    wi, wo = direction_pairs(light, view)
    half = nn.functional.normalize(wi + wo, dim=1)
    aligned = (wi * half).sum(1, keepdim=True)
    return torch.cat((wi[:, :2], wo[:, :2], half[:, :2], aligned, wi[:, 2:]), dim=1)
