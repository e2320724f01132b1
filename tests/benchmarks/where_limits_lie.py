"""Where the limits of a fit lie: `python -m tests.benchmarks.where_limits_lie RUN ...`.

For each run, with its own input: the error of pixels that see points beyond the border of the
texture, against all others; and by light, seen from above, how much of the gradient energy there is
and is kept.
"""

from __future__ import annotations

import argparse

import torch

from spmm_torch.data import BTF
from spmm_torch.evaluate.sharpness import GradientSums
from spmm_torch.evaluate.slice_sample import pairs_from_above
from spmm_torch.evaluate.slices import PictureOf, model_pictures
from spmm_torch.evaluate.source import open_source
from spmm_torch.metrics import snr_db
from spmm_torch.model.spmm import SPMM


def main() -> None:
    """Prints both tables of every run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", nargs="+", help="folder of a run")
    for run in parser.parse_args().run:
        source = open_source(run, None)
        pictures = model_pictures(source.model, source.btf)
        print(run)
        with torch.no_grad():
            print_border(source.model, source.btf, pictures)
            print_lights(source.btf, pictures)


def print_border(model: SPMM, btf: BTF, pictures: PictureOf) -> None:
    """Prints energies and errors inside of the border and beyond it."""
    relief = model.relief
    if relief is None:
        print("  no relief: every pixel sees its own texel")
        return
    surface = relief.field(model.height, model.width, btf.view)
    inside = surface.footprint(btf.view, relief.drift).inside.cpu()  # [V, T]
    energy, error = torch.zeros(2, 2, dtype=torch.float64)  # beyond, inside
    for view in range(len(btf.view)):
        where = inside[view].view(model.height, model.width)
        for light in range(len(btf.light)):
            wanted, found = btf.picture(view, light).double(), pictures(view, light).double()
            for side, part in enumerate((~where, where)):
                energy[side] += wanted[part].square().sum()
                error[side] += (wanted[part] - found[part]).square().sum()
    pixels = float((~inside).double().mean())
    share = float(error[0] / error.sum())
    print(f"  beyond the border: {pixels:.1%} of the pixels, {share:.1%} of the error")
    inner = snr_db(float(energy[1]), float(error[1]))
    whole = snr_db(float(energy.sum()), float(error.sum()))
    print(f"  {inner:.2f} dB inside, {whole:.2f} dB in all")


def print_lights(btf: BTF, pictures: PictureOf) -> None:
    """Prints the gradients of each light, seen from above."""
    pairs = pairs_from_above(btf)
    sums = [GradientSums.of(btf.picture(*pair), pictures(*pair)) for pair in pairs]
    total = sum(part.original for part in sums)
    for (_, light), part in sorted(zip(pairs, sums, strict=True), key=lambda x: -x[1].original):
        angle = float(btf.light[light, 2].clamp(-1.0, 1.0).acos().rad2deg())
        print(
            f"  light at {angle:.0f} degrees: {part.original / total:.1%} of the gradient energy,",
            end=" ",
        )
        print("flat" if part.share is None else f"{part.share:.0%} kept")


if __name__ == "__main__":
    main()
