"""Look at a BTF before a fit: are its values what a fit takes them for?

Guesses whether values hold the cosine and are linear, from exchanged
directions; reflected energy, missing pairs, clipped values, hot pixels, the
spacing of lights against the sharpest peaks, and how views are registered.

Exit code: 0 if all is fine, 1 if there is something to look at, 2 for bad
input.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING

from .inputs import add_reading, decode, reading
from .parser import Parser, add_cache, file_name
from .settings import wrapped

if TYPE_CHECKING:
    from spmm_torch.check import Finding

LOOK = 1
MARKS = {True: "fine", False: "LOOK", None: "?"}


def add_options(parser: Parser) -> None:
    """The options of `spmm check`."""
    add = parser.add_argument
    add("input", type=file_name, metavar="INPUT", help="BTF of any format that spmm fit reads")
    add_reading(parser)
    add("--json", action="store_true", help="print the findings and their figures as JSON")
    add_cache(parser)


def run(options: argparse.Namespace) -> list[str]:
    """Checks; the exit code tells whether there is something to look at."""
    from spmm_torch.check import check_btf
    from spmm_torch.data import load_input
    from spmm_torch.runtime.progress import Progress

    config, progress = reading(options), Progress()
    btf = load_input(options.input, replace(config.data, missing="mask"), config.seed)
    decode(btf, progress, options.cache)
    with progress.stage("check", len(btf.view), "views") as stage:
        found = check_btf(btf, stage)
    if any(each.fine is False for each in found):
        options.exit_code = LOOK
    if options.json:
        by_name = {each.name.replace(" ", "_"): each.to_dict() for each in found}
        return json.dumps({"input": btf.path} | by_name, indent=2).splitlines()
    size = f"{btf.width} x {btf.height} texels, {len(btf.view)} views, {len(btf.light)} lights"
    return [f"{btf.name}: {size}", *(line for each in found for line in lines_of(each))]


def lines_of(finding: Finding) -> list[str]:
    """A finding on one line, or on more where the terminal is narrow."""
    head = f"{MARKS[finding.fine]:4}  {finding.name:12}  "
    first, *rest = wrapped(finding.says + ".", 0, len(head))
    return [head + first, *rest]
