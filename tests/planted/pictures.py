"""Picture sets of random codes, as zips and folders."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np

from spmm_torch.data.codecs import radiance

GRID = ((0, 0), (15, 60), (30, 90), (60, 10), (75, 345))  # (theta, phi), sorted


def picture_name(view: int, light: int, suffix: str) -> str:
    (tv, pv), (tl, pl) = GRID[view], GRID[light]
    serial = light * len(GRID) + view
    return f"X/tv{tv:03}_pv{pv:03}/{serial:05} tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}{suffix}"


def encode_png(codes: np.ndarray) -> bytes:
    """A PNG at the depth of the codes."""
    return imagecodecs.png_encode(np.ascontiguousarray(codes))


def encode_atrium(codes: np.ndarray) -> bytes:
    """As ATRIUM stores them: the axes exchanged in words only, and the bottom row first."""
    height, width, _ = codes.shape
    usual = f"-Y {height} +X {width}\n".encode()
    return radiance.encode(codes[::-1].copy()).replace(usual, f"+X {width} -Y {height}\n".encode())


def write_pictures(
    path: Path,
    pictures: np.ndarray,
    encode: Callable[[np.ndarray], bytes],
    suffix: str,
    changes: dict[tuple[int, int], bytes] | None = None,
) -> Path:
    """Pictures `[V, L, H, W, B]` as a zip or, without an extension, a folder; some replaced."""
    files = {
        picture_name(view, light, suffix): (changes or {}).get((view, light)) or encode(picture)
        for view, row in enumerate(pictures)
        for light, picture in enumerate(row)
    }
    if path.suffix:
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        return path
    for name, content in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(content)
    return path


def random_codes(kind: str, shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """Codes `[*shape, B]` of a kind; of HDR kinds, values beyond 1."""
    rng = np.random.default_rng(seed)
    if kind in ("uint8", "uint16"):
        return rng.integers(0, np.iinfo(kind).max + 1, (*shape, 3), dtype=kind)
    if kind == "rgbe":
        values = rng.gamma(1.0, 2.0, (*shape, 3))
        return radiance.float_to_rgbe(values)
    return rng.gamma(1.0, 2.0, (*shape, 3)).astype(kind)
