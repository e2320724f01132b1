"""The settings of a fit: files, assignments and the names that they share with other modules."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from spmm_torch.brdf import MODEL_NAMES, PAPER_MODELS
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.schema import describe
from spmm_torch.errors import ConfigError
from tests.locations import CONFIGS


def test_defaults_are_default_yaml() -> None:
    assert FitConfig() == FitConfig.from_yaml(CONFIGS / "default.yaml")


def test_default_yaml_names_every_setting_that_default_methods_use() -> None:
    named = yaml.safe_load((CONFIGS / "default.yaml").read_text(encoding="utf-8"))
    assert named == FitConfig().to_dict()


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_file_sets_what_it_names(path: Path) -> None:
    held = FitConfig.from_yaml(path).to_dict()
    for name, value in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        assert held[name] == (held[name] | value if isinstance(value, dict) else value)


def test_paper_yaml_is_the_paper() -> None:
    """[WDR11 §3.2, §4.1]: 32 clusters, 8 samples, seven models, float32, no joint refit."""
    paper = FitConfig.from_yaml(CONFIGS / "paper.yaml")
    assert (paper.cluster.count, paper.sample.per_cluster) == (32, 8)
    assert paper.search.models == PAPER_MODELS
    assert paper.search.method == paper.select.method == "stagewise"
    assert (paper.dictionary.scope, paper.dictionary.horizon) == ("cluster", 0.0)
    assert (paper.residual.joint, paper.residual.precision) == (False, "float32")
    assert paper.relief.mode == "off"


def test_models_are_the_registry() -> None:
    """Those of the paper by default; all may be asked for."""
    assert FitConfig().search.models == PAPER_MODELS
    for name in MODEL_NAMES:
        assert FitConfig.from_dict({"search": {"models": [name]}}).search.models == (name,)


def test_yaml_round_trip(tmp_path: Path) -> None:
    config = FitConfig().override(
        ["search.models=[ward, ward_duer]", "select.max_lobes=4", "data.gamma=1", "seed=7"]
    )
    path = tmp_path / "config.yaml"
    path.write_text(config.to_yaml(), encoding="utf-8")
    assert FitConfig.from_yaml(path) == config
    assert FitConfig.from_dict(config.to_dict()) == config
    assert config.search.models == ("ward", "ward_duer")


def test_from_dict_keeps_other_defaults() -> None:
    config = FitConfig.from_dict({"select": {"max_lobes": 4}})
    assert config.select.max_lobes == 4
    assert config.override(["select.max_lobes=null"]) == FitConfig()


def test_later_assignments_win() -> None:
    assert FitConfig().override(["seed=1", "seed=2"]).seed == 2
    assert FitConfig().override([]) == FitConfig()
    assert FitConfig().override([" search.restarts = 8"]).search.restarts == 8


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("seed", r"--set seed has no '='; expected KEY=VALUE"),
        ("serach.restarts=8", "unknown setting serach; did you mean search"),
        ("search.restart=8", r"search.restart; did you mean search.restarts\?"),
        ("search=8", "search is 8; expected a section"),
        ("seed.low=1", "seed is a value, not a section"),
        ("=1", "unknown setting"),
        ("seed=", "seed is None; expected a whole number"),
        ("seed=-1", "seed is -1; expected 0 to 9223372036854775807"),
        ("seed=99999999999999999999999", "expected 0 to 9223372036854775807"),
        ("search.models=[wrad]", "did you mean ward?"),
        ("cluster.count=0", "cluster.count is 0; expected at least 1"),
        ("search.models={", "is not valid YAML"),
    ],
)
def test_bad_assignments(assignment: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        FitConfig().override([assignment])


def test_every_setting_is_explained() -> None:
    rows = describe(FitConfig)
    assert len({row.key for row in rows}) == len(rows)
    assert all(row.meaning for row in rows)


def test_off_needs_no_quotes(tmp_path: Path) -> None:
    """YAML 1.1 reads it as false."""
    config = FitConfig().override(["relief.mode=off", "relief.drift=off"])
    assert (config.relief.mode, config.relief.drift) == ("off", "off")
    path = tmp_path / "config.yaml"
    path.write_text("relief: {mode: off}", encoding="utf-8")
    assert FitConfig.from_yaml(path).relief.mode == "off"
    assert FitConfig.from_dict(config.to_dict()) == config
