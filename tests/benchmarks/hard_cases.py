"""What the hard cases reach: `python -m tests.benchmarks.hard_cases [NAME ...]`, by default all."""

from __future__ import annotations

import argparse
import time

from tests.hard.cases import CASES


def main() -> None:
    """Prints a row of the table in `docs/hard_cases.md` for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(CASES))
    names = parser.parse_args().names or list(CASES)
    print("| case | | lobes, at least | reached | with residual | reached | between | reached |")
    print("|---|---|---|---|---|---|---|---|")
    for name in names:
        case, start = CASES[name], time.perf_counter()
        result = case.fit()
        seconds = time.perf_counter() - start
        snr = result.report["snr_db"]
        cells = [name, case.what]
        for bound, reached in (
            (case.lobes, snr["without_residual"]),
            (case.model, snr["with_residual"]),
            (case.between, case.snr_between(result)),
        ):
            cells += ["" if x is None else f"{x:.1f} dB" for x in (bound, reached)]
        print("| " + " | ".join(cells) + f" | {seconds:.1f} s", flush=True)


if __name__ == "__main__":
    main()
