"""Settings of a fit: frozen dataclasses, read from and written to YAML.

Every field carries its meaning and range. An unknown key is an error that names the nearest
valid key.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..brdf import MODEL_NAMES, PAPER_MODELS
from ..errors import ConfigError
from .schema import MAX_SEED, assign, from_dict, parse_value, plain, setting
from .written import dump_text, read_yaml


@dataclass(frozen=True)
class DataConfig:
    """How the input is read."""

    gamma: float = setting(
        2.2,
        "display gamma: exponent that turns codes of 8 and 16 bits into linear values",
        low=0.01,
        high=10.0,
    )
    cosine: str = setting(
        "auto",
        "whether values contain the cosine of the light: included, missing (values are then "
        "multiplied by it), or auto (as a .btf file states; included for all other formats)",
        choices=("auto", "included", "missing"),
    )
    negative: str = setting(
        "refuse",
        "treatment of values below zero, such as noise after dark-frame subtraction: refuse the "
        "BTF, clip them to zero, or keep them",
        choices=("refuse", "clip", "keep"),
    )
    missing: str = setting(
        "refuse",
        "treatment of direction pairs without a picture: refuse the BTF, or mask them (no error "
        "counts there)",
        choices=("refuse", "mask"),
    )
    pattern: str | None = setting(
        None,
        "how pictures are named, such as L{tl}_{pl}_V{tv}_{pv}: polar angle t and azimuth p of "
        "light l and view v, in degrees, * for any text; null: each angle behind its letters tl, "
        "pl, tv or pv",
    )
    rings: int = setting(
        81,
        "number of directions at which tables of BRDFs (MERL, RGL) are read, as views and as "
        "lights: 81 (those of UBO2003) or 151 (of UBO2014)",
        choices=(81, 151),
    )
    rows: str = setting(
        "top",
        "row of the pictures that comes first in a .btf file that does not tell: top, as the "
        "library of the format's authors reads, or bottom, as btf.hh, BTF_extractor and spmm "
        "before 0.2 do",
        choices=("top", "bottom"),
    )
    crop: tuple[int, ...] | None = setting(
        None, "rectangle of texels to fit: left column, top row, width, height; null: all", low=0
    )
    texels: int | None = setting(
        None, "approximate number of texels to fit, spread over the texture; null: all", low=1
    )
    directions: str | None = setting(
        None,
        "directions to fit: every K-th ring (2), a list of polar angles in degrees (0,30,60), or "
        "indices (views=0-8;lights=0,4); null: all",
    )


@dataclass(frozen=True)
class WeightsConfig:
    """Weights of errors, by texel and direction pair; uniform by default."""

    scene: str | None = setting(
        None, "scene (YAML file) whose rendered pictures set the weights of errors; null: none"
    )
    file: str | None = setting(
        None,
        "weights of errors (NPZ file with arrays pair [views, lights], texel [height, width], or "
        "both); null: none",
    )
    floor: float = setting(
        0.05, "fraction of the weight that is spread evenly over all values", low=0.0, high=1.0
    )
    error: str = setting(
        "auto",
        "error to minimize: l2 (squared, as in the paper), cube-root or log (approximately the "
        "squared error of values after that compression), balanced (of values and of cube roots), "
        "or auto (l2, but for glossy data relative to each view, or balanced, or cube-root where "
        "peaks are narrower than the directions; balanced for scattered samples; l2 for "
        "search.method stagewise)",
        choices=("auto", "l2", "balanced", "cube-root", "log"),
    )


@dataclass(frozen=True)
class ReliefConfig:
    """The relief of the surface, through which views show its texels."""

    mode: str = setting(
        "auto",
        "relief that is found in the BTF and kept where views agree better by it: off, plane (one "
        "height for all texels at most), or auto (as much as pays)",
        choices=("off", "plane", "auto"),
    )
    height: str | None = setting(
        None,
        "grey picture of the heights, one value a texel, which are then kept (auto only); null: "
        "none, heights are found",
    )
    height_scale: float | None = setting(
        None,
        "height of white above black in relief.height, as a fraction of the texture's width; "
        "null: found in the BTF",
        low=-1.0,
        high=1.0,
    )
    drift: str = setting(
        "auto",
        "drift of registration of each view: auto (found, and kept where it pays), or off (views "
        "are taken as registered)",
        choices=("auto", "off"),
    )


@dataclass(frozen=True)
class ClusterConfig:
    """k-means over all texels [WDR11 §4.1]."""

    count: int = setting(32, "number of clusters, k", low=1)
    components: int = setting(
        32, "number of principal components in which texels are compared", low=1
    )
    iterations: int = setting(100, "maximum number of Lloyd iterations", low=1)


@dataclass(frozen=True)
class SampleConfig:
    """Stratified samples of each cluster [WDR11 §4.1]."""

    per_cluster: int = setting(
        8, "number of sample texels of each cluster, one from each sub-cluster", low=1
    )


@dataclass(frozen=True)
class SearchConfig:
    """The search for lobes on the samples [WDR11 §3.2, Eq. 5]."""

    method: str = setting(
        "corrective",
        "method of the search for lobes: stagewise (the paper's), or corrective (refits all lobes "
        "of a sample after each new lobe)",
        choices=("stagewise", "corrective"),
    )
    models: tuple[str, ...] = setting(
        PAPER_MODELS,
        "BRDF models of the lobes; ggx joins the default ones for peaks narrower than the "
        "directions, and of at most 32 texels, or unrelated ones, where weights.error auto is l2",
        choices=MODEL_NAMES,
    )
    max_lobes: int = setting(4, "maximum number of lobes of a sample", low=1, high=64)
    restarts: int | None = setting(
        None, "starting points of a new lobe; null: as many as fill a batch, at most 8", low=1
    )
    min_width: float = setting(
        0.25,
        "smallest width of a lobe, as a multiple of the angle between neighbouring measured "
        "directions; halved where samples are exact sums of few lobes",
        low=0.0,
        high=4,
    )
    bank_normals: int | None = setting(
        None,
        "number of normals in the bank of candidate lobes; null: 120 for few samples, else 64",
        low=1,
    )
    min_gain: float = setting(
        0.005,
        "smallest fraction of a sample's remaining error that a new lobe must remove",
        low=0.0,
        high=1,
    )
    refine_steps: int = setting(
        4, "maximum number of Levenberg-Marquardt steps after each new lobe", low=0
    )
    final_steps: int = setting(
        40, "maximum number of Levenberg-Marquardt steps after the last lobe", low=0
    )
    tolerance: float = setting(
        0.003,
        "smallest fraction of a sample's error that a Levenberg-Marquardt step must remove",
        low=0.0,
        high=1.0,
    )
    exchanges: int = setting(
        16,
        "maximum number of rounds that each replace one lobe of a few samples by a better one",
        low=0,
    )
    pairs: int = setting(
        512,
        "number of direction pairs on which Eq. 5 is maximized, all of them where there are no "
        "more (stagewise only)",
        low=16,
    )
    adam_steps: int = setting(8, "Adam steps from each starting point (stagewise only)", low=0)
    lbfgs_steps: int = setting(
        16, "L-BFGS evaluations from each starting point (stagewise only)", low=0
    )


@dataclass(frozen=True)
class StagewiseConfig:
    """Stagewise Lasso [ZY07], relative to the norm of each signal."""

    eta: float = setting(
        0.05, "step size eta, relative to the norm of the signal", low=1e-4, high=0.5
    )
    lambda_min: float = setting(0.05, "regularization lambda at which the path ends", low=0.0)
    max_steps: int = setting(200, "maximum number of forward and backward steps", low=1)


@dataclass(frozen=True)
class DictionaryConfig:
    """The dictionary of all lobes that were found on the samples [WDR11 §4.1]."""

    scope: str = setting(
        "shared",
        "lobes that a texel chooses from: cluster (those of its own cluster, as in the paper), or "
        "shared (those of all clusters)",
        choices=("cluster", "shared"),
    )
    merge: float = setting(
        0.999, "correlation above which two lobes are merged into one", low=0.0, high=1.0
    )
    horizon: float = setting(
        2.0,
        "degrees over its own horizon within which a lobe fades for views; 0: cut hard, as in the "
        "paper",
        low=0.0,
        high=45.0,
    )


@dataclass(frozen=True)
class SelectConfig:
    """The sparse fit of every texel with the dictionary [WDR11 §4.1]."""

    method: str = setting(
        "corrective",
        "method of the selection of lobes: stagewise (the paper's), or corrective (refits all "
        "weights of a texel after each new lobe)",
        choices=("stagewise", "corrective"),
    )
    max_lobes: int | None = setting(
        None, "maximum number of lobes of a texel; null: no limit", low=1
    )
    min_gain: float = setting(
        0.01,
        "smallest fraction of a texel's remaining error that a new lobe must remove",
        low=0.0,
        high=1.0,
    )
    pilot: int | None = setting(
        64,
        "number of texels of a large cluster (over four times as many) that choose from the whole "
        "dictionary; all other texels choose from the lobes of these; null: all texels",
        low=1,
    )


@dataclass(frozen=True)
class ResidualConfig:
    """What the lobes leave: one function for each cluster [WDR11 §4.1], or a few for all texels."""

    rank: int = setting(
        16,
        "number of functions that all texels share, each with one byte a texel for its share; 0: "
        "none, as in the paper",
        low=0,
        high=128,
    )
    clusters: bool = setting(
        False, "whether each cluster has a residual function of its own, as in the paper"
    )
    joint: bool = setting(
        True,
        "whether weights minimize the errors without and with the residual together; false: the "
        "error without it, as in the paper",
    )
    alternations: int = setting(
        3,
        "number of times that weights and the residual of the clusters are refit in turn (with "
        "residual.clusters and residual.joint)",
        low=1,
    )
    precision: str = setting(
        "float16", "number format of the stored residual", choices=("float16", "float32")
    )

    @property
    def beside_lobes(self) -> bool:
        """Whether lobes are chosen beside the residual of the clusters."""
        return self.clusters and self.joint


@dataclass(frozen=True)
class RefitConfig:
    """The last fit of weights and residual, to the pictures themselves."""

    steps: int = setting(
        15, "maximum number of steps that weights, and then the residual, are refit", low=0
    )
    sweeps: int = setting(
        2, "number of times that functions and coefficients of the residual are fit in turn", low=1
    )


@dataclass(frozen=True)
class StorageConfig:
    """How the model file holds what belongs to texels."""

    weights: str = setting(
        "auto",
        "number format of the weights: byte or int16 (both on a logarithmic scale), float32, or "
        "auto (the first of these that costs at most 0.02 dB, with and without the residual)",
        choices=("auto", "byte", "int16", "float32"),
    )


@dataclass(frozen=True)
class FitConfig:
    """All settings of a fit; the defaults are `configs/default.yaml`."""

    data: DataConfig = field(default_factory=DataConfig)
    weights: WeightsConfig = field(default_factory=WeightsConfig)
    relief: ReliefConfig = field(default_factory=ReliefConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    sample: SampleConfig = field(default_factory=SampleConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    stagewise: StagewiseConfig = field(default_factory=StagewiseConfig)
    dictionary: DictionaryConfig = field(default_factory=DictionaryConfig)
    select: SelectConfig = field(default_factory=SelectConfig)
    residual: ResidualConfig = field(default_factory=ResidualConfig)
    refit: RefitConfig = field(default_factory=RefitConfig)
    storage: StorageConfig = field(default_factory=StorageConfig)
    auto: bool = setting(
        False,
        "whether to leave out models and lobes that are not worth their bytes on held-out "
        "directions",
    )
    seed: int = setting(0, "seed of every random choice", low=0, high=MAX_SEED)
    device: str = setting(
        "auto", "device to compute on: auto (a GPU if there is one), cpu, cuda or cuda:N"
    )

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> FitConfig:
        """Settings from nested plain values as YAML gives them; missing keys keep their default.

        Raises:
            ConfigError: unknown key, wrong type or value out of range.
        """
        return from_dict(cls, values)

    @classmethod
    def from_yaml(cls, path: Path | str) -> FitConfig:
        """Settings from a YAML file.

        Raises:
            ConfigError: no such file, not valid YAML, or not valid settings.
        """
        return cls.from_dict(read_yaml(path))

    def to_dict(self) -> dict[str, Any]:
        """The settings as nested plain values, which `from_dict` reads back."""
        return plain(asdict(self))

    def to_yaml(self) -> str:
        """The settings as YAML text."""
        return dump_text(self.to_dict(), unicode=False)

    def override(self, assignments: list[str]) -> FitConfig:
        """A copy of the settings with assignments such as `search.restarts=8`, values in YAML.

        Raises:
            ConfigError: no `=`, unknown key, wrong type or value out of range.
        """
        config = self
        for assignment in assignments:
            key, separator, text = assignment.partition("=")
            if not separator:
                raise ConfigError(
                    f"--set {assignment} has no '='; expected KEY=VALUE such as search.restarts=8."
                )
            config = config.changed({key.strip(): parse_value(text, assignment, FitConfig)})
        return config

    def changed(self, changes: dict[str, Any]) -> FitConfig:
        """A copy of the settings with other plain values for keys such as `search.restarts`.

        Raises:
            ConfigError: unknown key, wrong type or value out of range.
        """
        values = self.to_dict()
        for key, value in changes.items():
            assign(values, key.split("."), value)
        return FitConfig.from_dict(values)
