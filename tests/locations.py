"""The checkout, and the test data that do not come with it.

The data lie in the folder that `SPMM_TEST_DATA` names, by default `../shared/data` beside the
checkout.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
CONFIGS = ROOT / "configs"
DATA = Path(os.environ.get("SPMM_TEST_DATA") or ROOT.parent / "shared" / "data")


def needs_data(*names: str) -> pytest.MarkDecorator:
    """A mark that skips a test where files of the test data are missing."""
    import pytest  # noqa: PLC0415 - scripts run where it is missing

    missing = ", ".join(name for name in names if not (DATA / name).is_file())
    reason = f"no {missing} in {DATA}; SPMM_TEST_DATA can name another folder"
    return pytest.mark.skipif(bool(missing), reason=reason)


def data_file(name: str) -> Path:
    """A file of the test data, for scripts.

    Raises:
        SystemExit: it is missing; the sentence says where it is looked for.
    """
    if not (DATA / name).is_file():
        raise SystemExit(f"no {name} in {DATA}; SPMM_TEST_DATA can name another folder.")
    return DATA / name
