"""`python -m spmm_torch.fit`, the same as `spmm fit`."""

import sys

from spmm_torch.cli.fit import main

if __name__ == "__main__":
    sys.exit(main())
