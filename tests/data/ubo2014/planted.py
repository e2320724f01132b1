"""Small BTFs: of integer factors, so that every product is exact, and of random values."""

from __future__ import annotations

import numpy as np

from spmm_torch.data import BTF
from spmm_torch.geometry.directions import ring_directions

VIEWS, LIGHTS, WIDTH, HEIGHT = 2, 3, 4, 5
VIEW = np.radians(np.array([[0.0, 0.0], [60.0, 135.0]], dtype=np.float32))
LIGHT = np.radians(np.array([[0.0, 0.0], [30.0, 90.0], [75.0, 345.0]], dtype=np.float32))
COMPONENTS = (3, 2, 4)  # of the channels of DFMF; the first one of FMF


def planted(variant: str, low: int = -3, high: int = 5, seed: int = 0) -> dict[str, object]:
    """Integer factors, exact in every type of number, and all that `sections` needs."""
    random = np.random.default_rng(seed)
    separate = variant == "DFMF08FC"
    pairs = VIEWS * LIGHTS * (1 if separate else 3)
    counts = COMPONENTS if separate else COMPONENTS[:1]
    return {
        "variant": variant,
        "left": [random.integers(low, high, (pairs, count)) for count in counts],
        "right": [random.integers(low, high, (WIDTH * HEIGHT, count)) for count in counts],
        "view": VIEW,
        "light": LIGHT,
        "width": WIDTH,
        "height": HEIGHT,
    }


def random_btf(height: int = 6, width: int = 5, views: int = 3, lights: int = 4) -> BTF:
    """Values of full rank, some above 1."""
    random = np.random.default_rng(5)
    directions = ring_directions()
    values = random.gamma(1.0, 0.3, (views, lights, height, width, 3)).astype(np.float32)
    return BTF.from_values(values, directions[5 : 5 + views], directions[-lights:], name="r")
