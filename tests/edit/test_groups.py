"""Groups of lobes by the paper's criterion."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import EVERYTHING, lobe_group, widths


def test_groups_share_all_lobes_and_follow_the_threshold(model: SPMM) -> None:
    assert lobe_group(model, "all") is EVERYTHING
    specular, other = (lobe_group(model, name).lobes for name in ("specular", "non_specular"))
    assert specular is not None
    assert other is not None
    assert torch.equal(specular, ~other)
    width = widths(model.dictionary.detach()).median().item()
    narrow = lobe_group(model, "specular", width).lobes
    assert narrow is not None
    assert 0 < int(narrow.sum()) < int(specular.sum())


def test_bad_groups(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="has no specular lobes.*choose another threshold"):
        lobe_group(model, "specular", 1e-4)
    for threshold in (0.0, 1e308, float("nan")):
        with pytest.raises(ConfigError, match="threshold is .*; expected a positive width .* 100"):
            lobe_group(model, "specular", threshold)
    with pytest.raises(ConfigError, match="expected one of all, specular, non_specular"):
        lobe_group(model, "shiny")
