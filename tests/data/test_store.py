"""What stores have in common."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.data.store import channels_first

DTYPES = (torch.uint8, torch.uint16, torch.float16, torch.float32)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("channels", [1, 3])
def test_channels_first(dtype: torch.dtype, channels: int) -> None:
    values = torch.arange(5 * 7 * channels).view(5, 7, channels).to(dtype)
    found = channels_first(values)
    assert found.dtype == dtype and found.is_contiguous()
    assert found.tolist() == values.transpose(1, 2).tolist()
    part = channels_first(values[::2])
    assert part.tolist() == found[::2].tolist()
