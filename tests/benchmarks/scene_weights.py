"""What a fit for one scene gains there and costs elsewhere.

`python -m tests.benchmarks.scene_weights` fits each material with and without the weights of a
scene, at several numbers of clusters, and compares pictures of that scene, and of others, with
those of the BTF itself by PSNR of display values. It prints the gain at equal bytes and the bytes
at equal PSNR, interpolated along the fits. Needs the test data.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from spmm_torch import BTF, SPMM, FitConfig, load_btf
from spmm_torch.config.render import SceneConfig
from spmm_torch.data import Selection
from spmm_torch.data.error_weights import Weights
from spmm_torch.fit import fit
from spmm_torch.fit.weighting import scene_weights
from spmm_torch.render import BTFMaterial, CosineSampled, Material, Rendering, auto_exposure, render
from spmm_torch.render.display import encode_display
from spmm_torch.render.scene_file import scene_of
from tests.locations import data_file

MATERIALS = ("WEAVE64", "TILES64")
# A sample on a table under one lamp; a ball in the sun; a ball in a studio, lit from all around.
SCENES = {
    "lamp": SceneConfig(
        shape="plane",
        repeat=1.0,
        camera="perspective:45,270,4,35",
        lights=("point:1,1.5,2,8,8,8",),
    ),
    "sun": SceneConfig(lights=("directional:45,60",)),
    "studio": SceneConfig(),
}
# Lobes narrower than half the angle between directions are right at measured pairs and wild between
# them, where pictures look: both fits do without.
SETTINGS = [
    "sample.per_cluster=2",
    "search.max_lobes=3",
    "search.restarts=1",
    "search.exchanges=0",
    "search.bank_normals=32",
    "search.final_steps=4",
    "search.min_width=0.5",
    "select.max_lobes=6",
]
PICTURE_SIZE = 96
MORE = 1.25


@dataclass(frozen=True)
class Point:
    """One fit: stored bytes, and PSNR in dB by scene."""

    clusters: int
    size: int
    snr: float
    psnr: dict[str, float]


def picture(material: Material, scene: SceneConfig, aspect: float) -> Rendering:
    """The same directions of light for every material: noise of sampling cancels."""
    settings = replace(scene, size=PICTURE_SIZE).settings
    return render(CosineSampled(material), scene_of(scene, aspect), settings)


def psnr(reference: Rendering, other: Rendering) -> float:
    """Of display values of covered pixels, under the exposure of the reference."""
    covered = reference.coverage > 0.0
    exposure = auto_exposure([reference.picture], [reference.coverage])
    first, second = (
        encode_display(rendering.picture[covered] * exposure) for rendering in (reference, other)
    )
    return -10.0 * math.log10(float((first - second).square().mean()))


@dataclass(frozen=True)
class Sample:
    """A material and its pictures."""

    btf: BTF
    config: FitConfig
    references: dict[str, Rendering]

    @classmethod
    def load(cls, name: str, side: int, scenes: list[str], settings: list[str]) -> Sample:
        selection = Selection(crop=(0, 0, side, side))
        btf = load_btf(data_file(f"{name}.zip"), selection=selection).load()
        material, aspect = BTFMaterial.build(btf), btf.width / btf.height
        references = {scene: picture(material, SCENES[scene], aspect) for scene in scenes}
        return cls(btf, FitConfig().override(settings), references)

    def weights(self, scene: str, floor: float) -> Weights:
        """By what the scene shows."""
        config, aspect = SCENES[scene], self.btf.width / self.btf.height
        own = scene_weights(self.btf, scene_of(config, aspect), config.settings, scene)
        return own.floored(floor)

    def points(self, clusters: list[int], weights: Weights | None) -> list[Point]:
        """A fit for each number of clusters."""
        points = []
        for count in clusters:
            config = self.config.override([f"cluster.count={count}"])
            result = fit(self.btf, config, weights=weights, render=False)
            size, snr = result.report["bytes"]["total"], result.report["snr_db"]["with_residual"]
            points.append(Point(count, size, snr, self.score(result.model)))
        return points

    def score(self, model: SPMM) -> dict[str, float]:
        """PSNR of the pictures of every scene."""
        aspect = self.btf.width / self.btf.height
        return {
            scene: psnr(reference, picture(model, SCENES[scene], aspect))
            for scene, reference in self.references.items()
        }


def gain_at_equal_bytes(plain: list[Point], weighted: Point, scene: str) -> float:
    """dB by which a weighted fit is closer than an unweighted one of as many bytes."""
    sizes, values = _curve(plain, scene)
    return weighted.psnr[scene] - float(np.interp(math.log(weighted.size), sizes, values))


def bytes_at_equal_error(weighted: list[Point], plain: Point, scene: str) -> float:
    """Bytes of a weighted fit over those of an unweighted one of the same PSNR; an upper bound.

    The smallest weighted fit counts where even that is better.
    """
    sizes, values = _curve(weighted, scene)
    values = np.maximum.accumulate(values)
    return math.exp(float(np.interp(plain.psnr[scene], values, sizes))) / plain.size


def _curve(points: list[Point], scene: str) -> tuple[np.ndarray, np.ndarray]:
    ordered = sorted(points, key=lambda point: point.size)
    sizes = np.array([math.log(point.size) for point in ordered])
    return sizes, np.array([point.psnr[scene] for point in ordered])


def main() -> None:
    """Prints a line for each fit and each comparison; with --json, all of it as a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--materials", nargs="+", default=list(MATERIALS))
    add("--scenes", nargs="+", default=["lamp", "sun"], choices=SCENES)
    add("--clusters", nargs="+", type=int, default=[3, 12])
    add("--side", type=int, default=32, help="texels each way")
    add("--floor", type=float, default=0.05, help="weights.floor")
    add("--set", nargs="+", default=[], metavar="KEY=VALUE", help="settings of all fits")
    add("--json", type=Path)
    options = parser.parse_args()
    torch.manual_seed(0)
    rows = []
    for name in options.materials:
        material = Sample.load(name, options.side, options.scenes, SETTINGS + options.set)
        # One larger than all others, so that as many bytes as a weighted fit has lie in between.
        more = math.ceil(MORE * options.clusters[-1])
        plain = material.points([*options.clusters, more], None)
        for point in plain:
            print(name, "unweighted", point, flush=True)
        for scene in options.scenes:
            weighted = material.points(options.clusters, material.weights(scene, options.floor))
            for point in weighted:
                print(name, scene, point, flush=True)
            rows.append(compare(name, scene, plain, weighted))
            print(rows[-1], flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def compare(name: str, scene: str, plain: list[Point], weighted: list[Point]) -> dict[str, object]:
    """What a scene's weights bring there and cost elsewhere, at the largest number of clusters."""
    most, own = plain[-2], weighted[-1]
    return {
        "material": name,
        "scene": scene,
        "gain_db": gain_at_equal_bytes(plain, own, scene),
        "bytes_ratio": bytes_at_equal_error(weighted, most, scene),
        "elsewhere_db": {
            other: own.psnr[other] - most.psnr[other] for other in own.psnr if other != scene
        },
        "all_pairs_db": own.snr - most.snr,
    }


if __name__ == "__main__":
    main()
