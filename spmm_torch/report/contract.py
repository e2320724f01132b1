"""`report.json`: one frozen dataclass, and how it is written and read.

Unknown figures, such as the errors of an edited model, are None: null in the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Self, TypeVar, get_type_hints

from ..runtime.atomic import is_text

FILE_NAME = "report.json"
VERSION = 1  # of the format; reports without one are of earlier releases

Built = TypeVar("Built")


@dataclass(frozen=True)
class Sizes:
    """Stored bytes of the parts of a model, and of the whole file."""

    weights: int
    dictionary: int
    residual: int
    total: int


@dataclass(frozen=True)
class PSNR:
    """Peak signal-to-noise ratios in dB."""

    without_residual: float | None = None
    with_residual: float | None = None


@dataclass(frozen=True)
class SNR:
    """Signal-to-noise ratios in dB; `cluster_mean`: of the bare mean of each cluster."""

    without_residual: float | None = None
    with_residual: float | None = None
    cluster_mean: float | None = None


@dataclass(frozen=True)
class MSSIM:
    """Mean structural similarity of sphere pictures, 0 to 1, by channel and over all."""

    y: float | None = None
    cr: float | None = None
    cb: float | None = None
    mean: float | None = None


@dataclass(frozen=True)
class Sharpness:
    """Shares of the original's gradient energy, in linear values.

    Attributes:
        from_above, all_views: that the model has, seen from above and over a sample of all views.
        in_place_from_above, in_place_all_views: that it has where the original has it.
    """

    from_above: float | None = None
    all_views: float | None = None
    in_place_from_above: float | None = None
    in_place_all_views: float | None = None


@dataclass(frozen=True)
class FLIP:
    """Mean FLIP errors of slices, 0 for pictures that look the same."""

    without_residual: float | None = None
    with_residual: float | None = None


@dataclass(frozen=True)
class Display:
    """What is seen of slices as 8-bit display values.

    Attributes:
        psnr_db: mean PSNR of the slices.
        flip: mean FLIP error of some of them.
        slices: how many.
    """

    psnr_db: PSNR = PSNR()
    flip: FLIP = FLIP()
    slices: int | None = None


@dataclass(frozen=True)
class FailedStarts:
    """Starts of the search: all, the failed ones, and these by cause."""

    starts: int | None = None
    count: int | None = None
    not_finite: int | None = None
    no_descent: int | None = None


@dataclass(frozen=True)
class ObjectiveFigures:
    """What the fit minimized, and what of the lobes is a guess.

    Attributes:
        error: l2, by-view, balanced, cube-root or log; all of them, with commas, where
            unrelated materials had their own.
        chosen_by: data or settings.
        narrow_lobes: lobes narrower than the measured directions resolve.
        narrow_energy: their share of the mean reflection of all lobes.
    """

    error: str | None = None
    chosen_by: str | None = None
    narrow_lobes: int | None = None
    narrow_energy: float | None = None


@dataclass(frozen=True)
class Ablation:
    """SNR in dB of lobes alone over some texels, and without each BRDF."""

    texels: int | None = None
    snr_db: float | None = None
    snr_db_without: dict[str, float] | None = None


@dataclass(frozen=True)
class Seconds:
    """Seconds by stage."""

    load: float | None = None
    objective: float | None = None
    relief: float | None = None
    cluster: float | None = None
    search: float | None = None
    dictionary: float | None = None
    select: float | None = None
    refit: float | None = None
    residual: float | None = None
    evaluate: float | None = None
    total: float | None = None


@dataclass(frozen=True)
class Report:
    """Every figure of a run, in the order of the file.

    Attributes:
        input: absolute path of the BTF, or its name.
        texels, direction_pairs, channels: of the input; pairs without a picture do not count.
        clusters: K.
        total_basis: lobes of the dictionary, J.
        mean_basis_per_texel: lobes of a texel.
        bytes: of the model.
        bytes_per_texel: of the model without what all texels share.
        raw_bytes: of the input at its own bit depth.
        compression_ratio: raw bytes over those of the model.
        psnr_peak: peak value of the PSNR.
        psnr_db, snr_db: over all texels, measured pairs and channels.
        weighted_snr_db: by the weights of the fit; None where all values count alike.
        mssim: of the sphere pictures.
        sharpness: shares of the gradients of slices.
        display: PSNR and FLIP of slices on a display.
        lobes_by_model: entries of texels by BRDF, the most used one first.
        objective: what was minimized.
        failed_starts: of the search.
        solvers: problems by solver and by how they ended: converged, limit, no_descent, not_finite.
        error_without_model: ablation of each BRDF.
        auto: the choice of `--auto`; None without it.
        materials: name, lobes and SNR of each texel where texels are materials; None for a texture.
        seconds: by stage.
        peak_memory_bytes: of the process on a CPU, of torch's allocations on a GPU.
        device: its name.
        seed: of every random choice.
        versions: by package.
        contents: hashes of the input, the weights of errors and the heights, as of a release; None
            where no command has made the run.
        format: version of the format.
    """

    input: str
    texels: int
    direction_pairs: int
    channels: int
    clusters: int
    total_basis: int
    mean_basis_per_texel: float
    bytes: Sizes
    bytes_per_texel: float
    raw_bytes: int
    compression_ratio: float
    psnr_peak: float
    psnr_db: PSNR
    snr_db: SNR
    weighted_snr_db: dict[str, float | None] | None
    mssim: MSSIM
    sharpness: Sharpness
    display: Display
    lobes_by_model: dict[str, int]
    objective: ObjectiveFigures
    failed_starts: FailedStarts
    solvers: dict[str, dict[str, int]]
    error_without_model: Ablation
    auto: dict[str, Any] | None
    materials: list[dict[str, Any]] | None
    seconds: Seconds
    peak_memory_bytes: int
    device: str
    seed: int
    versions: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, Any] | None = None
    format: int = VERSION

    def to_dict(self) -> dict[str, Any]:
        """The keys of `report.json` with their values, in order."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The report of `to_dict`.

        Raises:
            ValueError: keys are missing or unknown; the text names all of them.
        """
        check_report(values)
        return _built(cls, values)


def older_report(values: Any) -> Report:
    """The report of any release: figures that it lacks are None, others that it has are left out.

    Raises:
        ValueError: it is none: it lacks what reports of all releases have.
    """
    if not isinstance(values, Mapping) or not all(values.get(key) for key in ALWAYS):
        raise ValueError(f"it lacks {' or '.join(ALWAYS)}")
    known: dict[str, Any] = {}
    for key, below in REPORT_KEYS.items():
        value = values.get(key)
        group = value if isinstance(value, Mapping) else {}
        known[key] = {name: group.get(name) for name in below} if below else value
    return Report.from_dict(_with_inner(known) | {"format": VERSION})


def _with_inner(values: dict[str, Any]) -> dict[str, Any]:
    """The same with groups inside of groups complete, as `display.psnr_db`."""
    for key, kind in GROUPS.items():
        for name, inner in _groups(kind).items():
            found = values[key][name]
            group = found if isinstance(found, Mapping) else {}
            values[key][name] = {part.name: group.get(part.name) for part in fields(inner)}
    return values


def _groups(kind: type) -> dict[str, type]:
    """The fields of a dataclass whose values are dataclasses, and their classes."""
    hints: dict[str, type] = get_type_hints(kind)
    return {key: each for key, each in hints.items() if is_dataclass(each)}


def _built(kind: type[Built], values: Mapping[str, Any]) -> Built:
    """The dataclass of values, and of those in them."""
    groups = {key: _built(each, values[key]) for key, each in _groups(kind).items()}
    return kind(**{**values, **groups})


GROUPS = _groups(Report)
# What reports of all releases have.
ALWAYS = ("input", "raw_bytes")
# Every key in its order, with the keys below it; () for none, or for keys that vary.
REPORT_KEYS: dict[str, tuple[str, ...]] = {
    each.name: tuple(part.name for part in fields(GROUPS[each.name])) if each.name in GROUPS else ()
    for each in fields(Report)
}


def check_report(report: Mapping[str, Any]) -> None:
    """Check that a report has the keys of `REPORT_KEYS` and no others.

    Raises:
        ValueError: keys are missing or unknown; the text names all of them.
    """
    expected, found = set(REPORT_KEYS), set(report)
    for key, below in REPORT_KEYS.items():
        value = report.get(key)
        if below and key in report:
            expected |= {f"{key}.{name}" for name in below}
            found |= {f"{key}.{name}" for name in value} if isinstance(value, Mapping) else set()
    complaints = [
        f"{what} {', '.join(sorted(keys))}"
        for what, keys in (("missing:", expected - found), ("unknown:", found - expected))
        if keys
    ]
    if complaints:
        raise ValueError("report keys " + "; ".join(complaints))


def write_report(folder: Path, report: Report) -> Path:
    """Write `report.json` into `folder` and return its path.

    JSON knows neither NaN nor infinity: both become null.
    """
    path = folder / FILE_NAME
    path.write_text(json_text(report.to_dict()), encoding="utf-8")
    return path


def json_text(content: Mapping[str, Any]) -> str:
    """The text of a JSON file; numbers that are not finite become null.

    Where a name holds bytes that are no UTF-8, as paths may, letters beyond ASCII are escaped.
    """
    text = json.dumps(_finite(content), indent=2, allow_nan=False, ensure_ascii=False)
    if is_text(text):
        return text + "\n"
    return json.dumps(_finite(content), indent=2, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """The same value with None for each number that is not finite."""
    if isinstance(value, Mapping):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
