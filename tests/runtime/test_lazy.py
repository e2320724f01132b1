"""Packages whose names are imported at first use."""

from __future__ import annotations

import subprocess
import sys
from types import ModuleType

import pytest

import spmm_torch
import spmm_torch.fit


@pytest.mark.parametrize("package", [spmm_torch, spmm_torch.fit])
def test_every_name_is_there(package: ModuleType) -> None:
    assert set(package.__all__) <= set(dir(package))
    for name in package.__all__:
        assert getattr(package, name).__name__ == name


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="module 'spmm_torch' has no attribute 'SPMN'"):
        spmm_torch.SPMN  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'SPMN'"):
        from spmm_torch import SPMN  # noqa: F401


def test_torch_waits_for_a_name_that_needs_it() -> None:
    code = (
        "import sys, spmm_torch\n"
        "assert issubclass(spmm_torch.DataError, spmm_torch.SPMMError)\n"
        "config = spmm_torch.FitConfig()\n"
        "assert 'torch' not in sys.modules\n"
        "from spmm_torch import *\n"
        "assert 'torch' in sys.modules\n"
        "assert 'torch._dynamo' not in sys.modules\n"  # its compiler takes as long again
        "assert vars(spmm_torch)['SPMM'] is SPMM\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
