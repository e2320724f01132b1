"""Size of the blocks of texels in which the data are passed over."""

from __future__ import annotations

import torch

from .btf import BTF

# Values of a block, as float32: 16 MB on a CPU, where the system then reuses the same pages, and
# 2 GB on a GPU. They do not depend on the memory there is, so that sums round the same everywhere.
CPU_BLOCK_VALUES, CUDA_BLOCK_VALUES = 1 << 22, 1 << 29
# Copies of a block in memory: codes, codes with channels first, values, and a product.
BLOCK_COPIES = 4


def block_texels(btf: BTF, device: torch.device) -> int:
    """The number of texels of a block."""
    values = CUDA_BLOCK_VALUES if device.type == "cuda" else CPU_BLOCK_VALUES
    return max(1, values // (btf.pair_count * btf.channels))


def cpu_block_bytes() -> int:
    """The bytes of one block of values and its copies on a CPU."""
    return torch.float32.itemsize * BLOCK_COPIES * CPU_BLOCK_VALUES
