"""Our own settings: the shipped ones, and variants of the default."""

from __future__ import annotations

from dataclasses import dataclass

from ..brdf import PAPER_MODELS

DEFAULT = "default"
# Shipped settings, configs/NAME.yaml, in the order of the tables.
SHIPPED = ("fast", DEFAULT, "quality", "paper", "smoke")


@dataclass(frozen=True)
class Variant:
    """The default with some settings changed.

    Attributes:
        group: the kind of change.
        changes: as for `spmm fit --set`.
    """

    group: str
    changes: tuple[str, ...]

    @property
    def name(self) -> str:
        """The changes as one text."""
        return ", ".join(self.changes)


def _each(group: str, key: str, *values: object) -> list[Variant]:
    return [Variant(group, (f"{key}={value}",)) for value in values]


def _models(*names: str) -> Variant:
    return Variant("models", (f"search.models=[{', '.join(names)}]",))


# The group `lambda` varies the sparsity of the selection: `select.min_gain` of FoBa, the default,
# and `stagewise.lambda_min` of the paper's stagewise Lasso.
STAGEWISE = "select.method=stagewise"
VARIANTS: tuple[Variant, ...] = (
    *_each("samples", "sample.per_cluster", 1, 2, 4, 16),
    *_each("clusters", "cluster.count", 16, 64),
    *_each("starts", "search.restarts", 1, 4),
    *_each("starts", "search.bank_normals", 24, 120),
    *_each("steps", "search.final_steps", 0, 10),
    *_each("steps", "search.refine_steps", 1),
    *_each("steps", "search.exchanges", 0),
    *_each("lobes", "search.max_lobes", 2, 3, 6),
    *_each("dictionary", "dictionary.merge", 0.95, 0.98, 0.995),
    *_each("dictionary", "dictionary.scope", "cluster"),
    *_each("lambda", "select.min_gain", 0.002, 0.015, 0.04),
    *(Variant("lambda", (STAGEWISE, f"stagewise.lambda_min={x}")) for x in (0.05, 0.2)),
    _models("lambertian", "blinn_phong"),
    _models("lambertian", "ward"),
    _models("lambertian", "cook_torrance"),
    _models(*(name for name in PAPER_MODELS if name != "lafortune")),
    *_each("precision", "storage.weights", "byte", "float32"),
    *_each("residual", "residual.rank", 0, 8, 32),
    *_each("residual", "residual.joint", "false"),
    *_each("residual", "residual.clusters", "true"),
)
