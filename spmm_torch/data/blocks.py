"""How many texels are passed over at once, so that their values stay in memory."""

from __future__ import annotations

import torch

from .btf import BTF

# Values that are held as float32 at once while the data are passed over: 16 MB on a CPU, where the
# system then gives the same pages again and again, 2 GB on a GPU. The same whatever memory there
# is, so that sums round the same.
CPU_BLOCK_VALUES, CUDA_BLOCK_VALUES = 1 << 22, 1 << 29
# Copies of a block that are held at once: codes, codes channels first, values, a product.
BLOCK_COPIES = 4


def block_texels(btf: BTF, device: torch.device) -> int:
    """How many texels are passed over at once."""
    values = CUDA_BLOCK_VALUES if device.type == "cuda" else CPU_BLOCK_VALUES
    return max(1, values // (btf.pair_count * btf.channels))


def cpu_block_bytes() -> int:
    """Memory that one block of values takes on a CPU, with its copies."""
    return torch.float32.itemsize * BLOCK_COPIES * CPU_BLOCK_VALUES
