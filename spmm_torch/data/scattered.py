"""Reader of scattered samples: any list of light, view and colour, as NPZ or Parquet.

NPZ arrays: `wi [N, 3]`, `wo [N, 3]` and `rgb [N, 3]`, the values times the cosine of the light;
`texel [N]`, whole numbers from 0, where there is more than one; `size [2]` = (height, width) where
texels are a texture; `names [T]` where they are not. Parquet columns: `wi_x` to `wo_z`, `r`, `g`,
`b`, and `texel`.

Samples that fill a grid of lights and views, but for gaps, are read as one; a pair that is listed
again is averaged. All others stay lists of pairs, of each texel or of several that share one.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch

from ..errors import ConfigError, DataError
from .arrays import opener_in_memory
from .btf import BTF
from .directions import checked_directions, unit_directions
from .npz import read_array
from .options import DEFAULT_OPTIONS, ReadOptions
from .pair_lists import PairList
from .pictures import ZIP_ERRORS, list_files, material_name, open_zip
from .sample_grid import Grid, Samples, grid_of
from .scattered_btf import ScatteredBTF, no_store, spread_directions

EXPECTED = "an NPZ or Parquet file with a list of samples wi, wo and rgb"
REQUIRED = ("wi", "wo", "rgb")
OPTIONAL = ("texel", "size", "names")
COLUMNS = {
    "wi": ("wi_x", "wi_y", "wi_z"),
    "wo": ("wo_x", "wo_y", "wo_z"),
    "rgb": ("r", "g", "b"),
}
PARQUET_MAGIC = b"PAR1"
BYTES_PER_VALUE = 4  # of float32


def accepts(path: Path) -> bool:
    """Whether a file is Parquet, or an NPZ with the arrays of a list."""
    if path.is_dir():
        return False
    if zipfile.is_zipfile(path):
        return {f"{key}.npy" for key in REQUIRED} <= set(list_files(path))
    with path.open("rb") as stream:
        return stream.read(len(PARQUET_MAGIC)) == PARQUET_MAGIC


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Reads a list, all of it, as its directions tell the shape of the BTF.

    Raises:
        DataError: an array or column is missing or malformed, or a texel has no sample.
        ConfigError: a Parquet file is given and pyarrow is missing.
    """
    source = Path(path)
    arrays = _npz(source) if zipfile.is_zipfile(source) else _parquet(source)
    samples = _checked(arrays, source)
    grid = grid_of(samples, options.missing == "mask", source)
    return _scattered(samples, source) if grid is None else _gridded(samples, grid, source)


def _gridded(samples: Samples, grid: Grid, path: Path) -> BTF:
    """The BTF of a grid."""
    height, width = samples.size
    missing = grid.missing
    values = np.where(missing[..., None, None], np.float32(0.0), grid.values)
    whole = values.reshape(len(grid.view), len(grid.light), height, width, 3)
    return BTF(
        name=material_name(path),
        path=str(path),
        height=height,
        width=width,
        view=checked_directions(torch.from_numpy(grid.view), f"'wo' of {path}"),
        light=checked_directions(torch.from_numpy(grid.light), f"'wi' of {path}"),
        bytes_per_value=BYTES_PER_VALUE,
        open_store=opener_in_memory(whole, str(path)),
        hdr=None,
        missing=torch.from_numpy(missing) if missing.any() else None,
        names=samples.names,
    )


def _scattered(samples: Samples, path: Path) -> ScatteredBTF:
    """The BTF of lists of pairs."""
    wi = unit_directions(torch.from_numpy(samples.wi), f"'wi' of {path}")
    wo = unit_directions(torch.from_numpy(samples.wo), f"'wo' of {path}")
    lists = tuple(_lists(wi.numpy(), wo.numpy(), samples))
    height, width = samples.size
    return ScatteredBTF(
        name=material_name(path),
        path=str(path),
        height=height,
        width=width,
        view=spread_directions(wo),
        light=spread_directions(wi),
        bytes_per_value=BYTES_PER_VALUE,
        open_store=no_store,
        hdr=None,
        names=samples.names,
        raw=lists,
    )


def _lists(wi: np.ndarray, wo: np.ndarray, samples: Samples) -> Iterator[PairList]:
    """The texels of each list, in the order of their first texels.

    Args:
        wi, wo: unit directions of the samples, `[N, 3]` float32.
        samples: texels and values; those of one texel and pair are averaged.
    """
    texel, pairs, rgb = _averaged(samples.texel, np.concatenate((wi, wo), axis=1), samples.rgb)
    ends = np.cumsum(np.bincount(texel, minlength=math.prod(samples.size)))
    parts = [slice(a, b) for a, b in zip((0, *ends[:-1].tolist()), ends.tolist(), strict=True)]
    sharing: dict[bytes, list[int]] = {}
    for index, part in enumerate(parts):
        sharing.setdefault(hashlib.sha256(pairs[part].tobytes()).digest(), []).append(index)
    for texels in sharing.values():
        own = torch.from_numpy(pairs[parts[texels[0]]])
        values = torch.from_numpy(np.stack([rgb[parts[index]] for index in texels]))
        yield PairList(torch.tensor(texels), own[:, :3].clone(), own[:, 3:].clone(), values)


def _averaged(
    texel: np.ndarray, pairs: np.ndarray, rgb: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples sorted by texel and pair, each pair of a texel once.

    Args:
        texel: `[N]`.
        pairs: light and view, `[N, 6]`.
        rgb: `[N, 3]`.
    """
    order = np.lexsort((*pairs.T[::-1], texel))
    texel, pairs = texel[order], pairs[order]
    other = np.any(np.diff(pairs, axis=0) != 0.0, axis=1) | (np.diff(texel) != 0)
    first = np.flatnonzero(np.concatenate(([True], other)))
    count = np.diff(np.append(first, len(texel)))
    total = np.add.reduceat(rgb[order].astype(np.float64), first, axis=0)
    return texel[first], pairs[first], (total / count[:, None]).astype(np.float32)


def _npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an NPZ."""
    try:
        with open_zip(path) as handle:
            members = handle.namelist()
            keys = [key for key in (*REQUIRED, *OPTIONAL) if f"{key}.npy" in members]
            return {key: read_array(handle, key) for key in keys}
    except (*ZIP_ERRORS, OSError, ValueError) as error:
        raise DataError(
            f"{path} cannot be read ({error}); expected an NPZ with wi, wo and rgb, [N, 3] each; "
            f"save it again with numpy.savez."
        ) from error


def _parquet(path: Path) -> dict[str, np.ndarray]:
    """The columns of a Parquet file, as the arrays of an NPZ."""
    try:
        from pyarrow import ArrowException, parquet  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(
            f"{path} is a Parquet file, for which pyarrow is missing; install it by "
            f"pip install 'spmm_torch[parquet]', or save the list as NPZ."
        ) from error
    try:
        table = parquet.read_table(path)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
    except (ArrowException, OSError) as error:
        raise DataError(
            f"{path} cannot be read ({' '.join(str(error).split())}); expected a whole Parquet "
            f"file; copy it again."
        ) from error
    wanted = [name for names in COLUMNS.values() for name in names]
    if lacking := [name for name in wanted if name not in columns]:
        raise DataError(
            f"{path} lacks the columns {', '.join(lacking)}; expected {', '.join(wanted)}, and "
            f"texel where there is more than one; rename them."
        )
    arrays = {
        key: np.stack([_numbers(columns[name], name, path) for name in names], axis=1)
        for key, names in COLUMNS.items()
    }
    return arrays | {key: columns[key] for key in ("texel",) if key in columns}


def _numbers(column: np.ndarray, name: str, path: Path) -> np.ndarray:
    """A column `[N]` as float64."""
    try:
        return column.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(
            f"column {name!r} of {path} cannot be read as numbers ({error}); expected a float for "
            f"each sample; save it so."
        ) from error


def _checked(arrays: Mapping[str, np.ndarray], path: Path) -> Samples:
    """The list, with shapes that agree.

    Raises:
        DataError: they do not, a texel has no sample, or a number is not finite.
    """
    count = len(arrays["rgb"]) if arrays["rgb"].ndim else 0
    for key in REQUIRED:
        array = arrays[key]
        if array.shape != (count, 3) or not count or array.dtype.kind not in "fiu":
            raise DataError(
                f"{key!r} of {path} has type {array.dtype} and shape {list(array.shape)}; expected "
                f"numbers [N, 3], N the same for wi, wo and rgb; save it so."
            )
    texel = arrays.get("texel", np.zeros(count, np.int64))
    if texel.shape != (count,) or texel.dtype.kind not in "iu" or texel.min() < 0:
        raise DataError(
            f"'texel' of {path} has type {texel.dtype} and shape {list(texel.shape)}; expected "
            f"[{count}] whole numbers from 0, the texel of each sample; save it so."
        )
    texels = int(texel.max()) + 1
    present = np.unique(texel)
    if len(present) < texels:  # told before anything is made for each number: one may be 10^9
        gap = int(np.argmax(present != np.arange(len(present))))
        raise DataError(
            f"'texel' of {path} has no sample of texel {gap}, of {texels}; expected at least one "
            f"of each from 0; number them anew."
        )
    size, names = _layout(arrays, texels, path)
    if not np.isfinite(arrays["rgb"]).all():
        raise DataError(
            f"'rgb' of {path} holds a value that is not finite, the first at sample "
            f"{int(np.argwhere(~np.isfinite(arrays['rgb']))[0, 0])}; expected numbers; remove it."
        )
    wi, wo, rgb = (arrays[key].astype(np.float64) for key in REQUIRED)
    return Samples(wi, wo, rgb.astype(np.float32), texel.astype(np.int64), size, names)


def _layout(
    arrays: Mapping[str, np.ndarray], count: int, path: Path
) -> tuple[tuple[int, int], tuple[str, ...] | None]:
    """The size of the texture, and the names of T texels that are none."""
    if "size" in arrays:
        size = arrays["size"]
        if size.shape != (2,) or size.dtype.kind not in "iu" or math.prod(size.tolist()) != count:
            raise DataError(
                f"'size' of {path} is {size.tolist()}; expected (height, width) of {count} texels, "
                f"as 'texel' counts them; make the two agree."
            )
        return (int(size[0]), int(size[1])), None
    names = arrays.get("names", np.array([f"texel {index}" for index in range(count)]))
    if names.dtype.kind != "U" or names.shape != (count,):
        raise DataError(
            f"'names' of {path} has type {names.dtype} and shape {list(names.shape)}; expected "
            f"[{count}] texts, one for each number in 'texel'; make the two agree."
        )
    return (1, count), tuple(names.tolist())
