"""The command line of `spmm fit`."""

from __future__ import annotations

import argparse

from .config import FitConfig
from .schema import describe


def parser() -> argparse.ArgumentParser:
    """The options of `spmm fit`."""
    rows = "\n".join(
        f"  {key} ({default}): {meaning}" for key, default, meaning in describe(FitConfig)
    )
    result = argparse.ArgumentParser(
        prog="spmm fit",
        description="Fit a sparse parametric mixture model to a BTF. Start it with torchrun to "
        "share the work among processes.",
        epilog=f"settings for --config and --set, with their defaults:\n{rows}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = result.add_argument
    add("input", help="zip or folder of pictures (UBO2003, ATRIUM, OpenEXR), UBO2014 .btf, or NPZ")
    add("-o", "--output", required=True, metavar="RUN", help="folder to make")
    add("--config", metavar="YAML", help="settings; default: configs/default.yaml")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, repeatable")
    add("--device", help="auto, cpu, cuda or cuda:N")
    add("--seed", type=int, help="seed of every random choice")
    add("--crop", metavar="X0,Y0,W,H", help="fit this rectangle of texels only")
    add("--texels", type=int, metavar="N", help="fit about N texels only, spread over the picture")
    add(
        "--directions",
        metavar="K",
        help="fit every K-th ring of directions; or polar angles such "
        "as 0,30,60; or indices such as 'views=0-8;lights=0,4'",
    )
    add("--scene", metavar="YAML", help="errors count by what the pictures of this scene show")
    add(
        "--weights", metavar="NPZ", help="errors count by pair [V, L] and texel [H, W] in this file"
    )
    add(
        "--auto",
        action="store_const",
        const=True,
        help="leave out models and lobes that do not pay for their bytes on held-out directions",
    )
    add("--resume", action="store_true", help="go on with a run that was stopped")
    add("--no-render", action="store_true", help="no sphere pictures, so no MSSIM; saves seconds")
    add("--max-memory", metavar="SIZE", help="such as 4GB; default: half of what is free")
    add("--cache", metavar="FOLDER", help="keep decoded values here, for later runs too")
    return result


def assignments(options: argparse.Namespace) -> list[str]:
    """Settings that have an option of their own."""
    given = {
        "device": options.device,
        "seed": options.seed,
        "auto": "true" if options.auto else None,
        "data.crop": f"[{options.crop}]" if options.crop else None,
        "data.texels": options.texels,
        "data.directions": f"'{options.directions}'" if options.directions else None,
        "weights.scene": f"'{options.scene}'" if options.scene else None,
        "weights.file": f"'{options.weights}'" if options.weights else None,
    }
    return [f"{key}={value}" for key, value in given.items() if value is not None]
