"""Reader of scattered samples: any list of light, view and colour, as NPZ or Parquet.

NPZ arrays: `wi [N, 3]`, `wo [N, 3]` and `rgb [N, 3]`, the values times the cosine of the light;
`texel [N]`, whole numbers from 0, where there is more than one; `size [2]` = (height, width) where
texels are a texture; `names [T]` where they are not. Parquet columns: `wi_x` to `wo_z`, `r`, `g`,
`b`, and `texel`.

Samples are kept where they lie: views and lights are the distinct directions of the list, and pairs
of them without a sample are missing.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ..errors import ConfigError, DataError
from .arrays import opener_in_memory
from .btf import BTF
from .directions import SAME_DIRECTION, checked_directions
from .npz import read_array
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import ZIP_ERRORS, material_name, open_zip

EXPECTED = "an NPZ or Parquet file with a list of samples wi, wo and rgb"
REQUIRED = ("wi", "wo", "rgb")
OPTIONAL = ("texel", "size", "names")
COLUMNS = {
    "wi": ("wi_x", "wi_y", "wi_z"),
    "wo": ("wo_x", "wo_y", "wo_z"),
    "rgb": ("r", "g", "b"),
}
PARQUET_MAGIC = b"PAR1"
# Pairs of distinct directions at most: a fit takes time and memory for each, with a sample or not.
MAX_PAIRS = 1 << 17
BYTES_PER_VALUE = 4  # of float32


@dataclass(frozen=True)
class Samples:
    """A list of N samples.

    Attributes:
        wi, wo: unit directions to light and view, `[N, 3]`.
        rgb: values, `[N, 3]`.
        texel: of each sample, `[N]`.
        size: (height, width) of the texture; one row where texels are no texture.
        names: of the texels; None for a texture.
    """

    wi: np.ndarray
    wo: np.ndarray
    rgb: np.ndarray
    texel: np.ndarray
    size: tuple[int, int]
    names: tuple[str, ...] | None


def accepts(path: Path) -> bool:
    """Whether a file is Parquet, or an NPZ with the arrays of a list."""
    if path.is_dir():
        return False
    if zipfile.is_zipfile(path):
        with open_zip(path) as handle:
            return {f"{key}.npy" for key in REQUIRED} <= set(handle.namelist())
    with path.open("rb") as stream:
        return stream.read(len(PARQUET_MAGIC)) == PARQUET_MAGIC


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Reads a list, all of it, as its directions tell the shape of the BTF.

    Raises:
        DataError: an array or column is missing or malformed, directions are too many, or a texel
            lacks a pair that another has and `options.missing` does not mask it.
        ConfigError: a Parquet file is given and pyarrow is missing.
    """
    source = Path(path)
    arrays = _npz(source) if zipfile.is_zipfile(source) else _parquet(source)
    samples = _checked(arrays, source)
    view, light, values = _gathered(samples, source)
    missing = _missing(values, options.missing == "mask", samples, source)
    if missing is not None:
        values[missing] = 0.0
    height, width = samples.size
    whole = values.reshape(len(view), len(light), height, width, 3)
    return BTF(
        name=material_name(source),
        path=str(path),
        height=height,
        width=width,
        view=checked_directions(torch.from_numpy(view), f"'wo' of {path}"),
        light=checked_directions(torch.from_numpy(light), f"'wi' of {path}"),
        bytes_per_value=BYTES_PER_VALUE,
        open_store=opener_in_memory(whole, str(path)),
        hdr=None,
        missing=None if missing is None else torch.from_numpy(missing),
        names=samples.names,
    )


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
        key: np.stack([columns[name].astype(np.float64) for name in names], axis=1)
        for key, names in COLUMNS.items()
    }
    return arrays | {key: columns[key] for key in ("texel",) if key in columns}


def _checked(arrays: Mapping[str, np.ndarray], path: Path) -> Samples:
    """The list, with shapes that agree.

    Raises:
        DataError: they do not, or a number is not finite.
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
    size, names = _layout(arrays, int(texel.max()) + 1, path)
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


def _gathered(samples: Samples, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distinct views `[V, 3]` and lights `[L, 3]`, and values `[V, L, T, 3]`, NaN without a sample.

    Samples of one texel and pair are averaged.
    """
    view, at_view = _distinct(samples.wo, f"'wo' of {path}")
    light, at_light = _distinct(samples.wi, f"'wi' of {path}")
    if len(view) * len(light) > MAX_PAIRS:
        raise DataError(
            f"the {len(samples.rgb)} samples of {path} have {len(view)} distinct views and "
            f"{len(light)} distinct lights; expected at most {MAX_PAIRS:,} pairs of them, as a fit "
            f"takes all; measure fewer directions again and again, or split the list by texels."
        )
    if not np.isfinite(samples.rgb).all():
        raise DataError(
            f"'rgb' of {path} holds a value that is not finite, the first at sample "
            f"{int(np.argwhere(~np.isfinite(samples.rgb))[0, 0])}; expected numbers; remove it."
        )
    shape = (len(view), len(light), math.prod(samples.size))
    place = np.ravel_multi_index((at_view, at_light, samples.texel), shape)
    total, count = np.zeros((math.prod(shape), 3)), np.bincount(place, minlength=math.prod(shape))
    np.add.at(total, place, samples.rgb)
    values = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    return view, light, values.astype(np.float32).reshape(*shape, 3)


def _distinct(directions: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Directions `[M, 3]` of which no two are the same, and which one each of `[N, 3]` is."""
    _check_finite(directions, where)
    exact, back = np.unique(directions, axis=0, return_inverse=True)
    near = KDTree(exact).query_pairs(SAME_DIRECTION, output_type="ndarray")
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(exact),) * 2)
    _, group = connected_components(links, directed=False)
    _, first, order = np.unique(group, return_index=True, return_inverse=True)
    return exact[first], order[back.reshape(-1)]


def _check_finite(directions: np.ndarray, where: str) -> None:
    if not np.isfinite(directions).all():
        raise DataError(
            f"{where} holds a direction that is not finite, the first at sample "
            f"{int(np.argwhere(~np.isfinite(directions))[0, 0])}; expected unit vectors; remove it."
        )


def _missing(values: np.ndarray, mask: bool, samples: Samples, path: Path) -> np.ndarray | None:
    """Pairs `[V, L]` that count for no texel; None if all do.

    Raises:
        DataError: a texel lacks a pair that another has, and such pairs are not masked.
    """
    lacking: np.ndarray = np.isnan(values[..., 0])  # [V, L, T]
    everywhere, somewhere = np.all(lacking, axis=-1), np.asarray(np.any(lacking, axis=-1))
    partly = somewhere & ~everywhere
    if partly.any() and not mask:
        view, light = np.argwhere(partly)[0].tolist()
        texel = int(lacking[view, light].argmax())
        named = f"texel {texel}" if samples.names is None else repr(samples.names[texel])
        raise DataError(
            f"{named} of {path} has no sample at view {view}, light {light}, which other texels "
            f"have ({int(partly.sum())} such pairs); expected the same pairs in all texels; fit "
            f"them apart, or leave these pairs out by data.missing=mask."
        )
    if somewhere.all():
        raise DataError(
            f"the texels of {path} have no pair of directions in common; expected at least one; "
            f"fit them apart."
        )
    return somewhere if somewhere.any() else None
