"""`python -m spmm_torch.fit`, the same as `spmm fit`."""

import sys
from importlib.util import find_spec
from pathlib import Path

import spmm_torch

if __name__ == "__main__":
    if find_spec("spmm_torch.cli") is None:
        # A checkout that is not installed: cli/, configs/ and viz/ lie beside the package.
        spmm_torch.__path__.append(str(Path(spmm_torch.__file__).parents[1]))
    from spmm_torch.cli.start import start

    sys.exit(start(["fit", *sys.argv[1:]]))
