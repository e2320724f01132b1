"""Makes a UBO2003 zip of full size by tiling a small one: `python tests/synthetic/tiled_sample.py
OUT.zip [--source SMALL.zip] [--size 256]`.

The tiles differ by a smooth field of gains for each channel, so that no two texels are alike.
"""

from __future__ import annotations

import argparse
import io
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

from spmm_torch.data import sample_path
from spmm_torch.data.named_pictures import list_pictures

# The gains: their range, and how many waves of them fit into the picture.
DARKEST, BRIGHTEST, WAVES = 0.6, 1.0, 5
QUALITY = 85
FULL_COLOUR = 0  # Pillow's number for 4:4:4
BATCH = 81


def gain_field(size: int, seed: int) -> np.ndarray:
    """Smooth gains `[size, size, 3]`, between DARKEST and BRIGHTEST."""
    generator = np.random.default_rng(seed)
    field = np.zeros((size, size, 3))
    rows, columns = np.mgrid[0:size, 0:size] / size
    for _ in range(8):
        wave = generator.integers(-WAVES, WAVES + 1, (2, 3))
        phase = generator.uniform(0.0, 2.0 * np.pi, 3)
        angle = rows[..., None] * wave[0] + columns[..., None] * wave[1]
        field += np.cos(2.0 * np.pi * angle + phase)
    field = (field - field.min()) / (field.max() - field.min())
    return DARKEST + (BRIGHTEST - DARKEST) * field


def tiled(payload: bytes, gain: np.ndarray) -> bytes:
    """A JPEG of a picture repeated over `gain [size, size, 3]`."""
    with Image.open(io.BytesIO(payload)) as image:
        tile = np.asarray(image.convert("RGB"))
    size = len(gain)
    repeats = [-(-size // side) for side in tile.shape[:2]]
    whole = np.tile(tile, (*repeats, 1))[:size, :size]
    buffer = io.BytesIO()
    picture = Image.fromarray((whole * gain).round().astype(np.uint8))
    picture.save(buffer, "JPEG", quality=QUALITY, subsampling=FULL_COLOUR)
    return buffer.getvalue()


def members(source: Path, gain: np.ndarray) -> Iterator[tuple[str, bytes]]:
    """Names and contents of all pictures."""
    names = list_pictures(source)
    with zipfile.ZipFile(source) as archive, ThreadPoolExecutor() as pool:
        for start in range(0, len(names), BATCH):
            batch = names[start : start + BATCH]
            payloads = [archive.read(name) for name in batch]
            yield from zip(batch, pool.map(lambda p: tiled(p, gain), payloads), strict=True)


def main() -> None:
    """Writes the zip."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("--source", type=Path, default=sample_path())
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    gain = gain_field(options.size, options.seed)
    with zipfile.ZipFile(options.output, "w") as archive:
        for name, content in members(options.source, gain):
            archive.writestr(name, content)


if __name__ == "__main__":
    main()
