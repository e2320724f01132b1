"""Measured glossy materials: `python -m tests.benchmarks.glossy_materials`.

The seven of `tests/glossy.py` on both grids, as fits of four lobes with the default settings,
beside one GGX and a Lambertian by least squares. `--only NAME` takes one, `--grid 81` one grid,
and `--set KEY=VALUE` other settings. With `--apart` they are fit to scattered samples, half of the
random pairs that the others are judged by, and judged by the other half. Needs the test data.
"""

from __future__ import annotations

import argparse

from spmm_torch.fit import fit
from tests.glossy import (
    FOUR_LOBES,
    GRIDS,
    Figures,
    figures,
    ggx_and_lambert,
    material,
    material_names,
    of_model,
)


def row(name: str, own: Figures) -> str:
    """One row of the table."""
    albedo = ", ".join(f"{ratio:.2f}" for ratio in own.albedo)
    return (
        f"| {name} | {own.on_samples:.1f} | {own.on_samples_seen:.1f} | {own.between:.1f} "
        f"| {own.mirror:.1f} | {own.body:.1f} | {albedo} |"
    )


def main() -> None:
    """Prints the rows of the table in `docs/hard_cases.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", metavar="NAME", help="this one; repeatable")
    parser.add_argument("--grid", type=int, action="append", choices=GRIDS)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--apart", action="store_true", help="fit to scattered samples")
    options = parser.parse_args()
    config = FOUR_LOBES.override(options.set)
    if options.apart:
        for name in options.only or material_names():
            btf, own = material(name, GRIDS[0]).apart()
            model = fit(btf, config, render=False).model
            print(row(f"{name} apart", figures(own, of_model(model))), flush=True)
        return
    for grid in options.grid or GRIDS:
        for name in options.only or material_names():
            own = material(name, grid)
            model = fit(own.btf(), config, render=False).model
            print(row(f"{name} {grid}", figures(own, of_model(model))), flush=True)
            print(row("its lobes alone", figures(own, of_model(model, residual=False))), flush=True)
            for seen in (True, False):
                what = "cube roots" if seen else "raw values"
                found = figures(own, ggx_and_lambert(own, seen=seen))
                print(row(f"GGX + Lambert, {what}", found), flush=True)


if __name__ == "__main__":
    main()
