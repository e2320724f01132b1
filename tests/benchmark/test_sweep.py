"""Our own settings: every variant is valid, and what is shared between fits changes nothing."""

from __future__ import annotations

import pytest
import torch
import yaml

from spmm_torch.benchmark import sweep
from spmm_torch.benchmark.fits import EARLY_STAGES, SharedStages, TimedFit, on_device
from spmm_torch.benchmark.scope import Bench
from spmm_torch.benchmark.variants import DEFAULT, SHIPPED, VARIANTS, Variant
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.shipped import shipped
from spmm_torch.fit import fit
from tests.locations import CONFIGS

CPU = torch.device("cpu")


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_a_variant_changes_the_default(variant: Variant) -> None:
    assert FitConfig().override(list(variant.changes)) != FitConfig()


def test_the_issue_names_what_is_swept() -> None:
    groups = {variant.group for variant in VARIANTS}
    assert {"samples", "starts", "steps", "dictionary", "lambda", "models", "precision"} <= groups


def test_every_shipped_file_is_measured() -> None:
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == set(SHIPPED)
    for name in SHIPPED:
        text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
        assert shipped(name) == FitConfig.from_dict(yaml.safe_load(text))


def test_shared_stages_change_no_figure(bench: Bench) -> None:
    config = on_device(shipped(DEFAULT, bench.scope.overrides), CPU)
    other = config.override(["select.min_gain=0.1"])
    alone = fit(bench.open(), other).report
    with SharedStages.open() as shared:
        first = shared.fit(bench, config)
        second = shared.fit(bench, other).result.report
        third = shared.fit(bench, config.override(["sample.per_cluster=1"]))
        folder = shared.folder
        assert sorted(path.name for path in folder.iterdir()) == ["0", "1"]
        assert sorted(path.name for path in (folder / "0").iterdir()) == sorted(EARLY_STAGES)
    assert not folder.exists()
    # What is taken over tells the seconds that it took; what is searched anew takes its own.
    assert second["seconds"]["search"] == first.stages["search"]
    assert third.stages["search"] != first.stages["search"]
    assert second["snr_db"] == alone["snr_db"]
    assert second["bytes"] == alone["bytes"]


def test_float32_takes_more_bytes(
    bench: Bench, default: TimedFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "SHIPPED", (DEFAULT,))
    rows = {row["name"]: row for row in sweep.run(bench, default)["rows"]}
    names = [f"storage.weights={kind}" for kind in ("byte", "float32")]
    assert set(rows) == {DEFAULT, *names}
    sizes = [rows[name]["bytes"]["weights"] for name in names]
    assert sizes[1] > sizes[0]
    assert rows[names[0]]["on_front"]["bytes"]


def test_a_higher_rank_needs_coordinates_of_its_own(bench: Bench) -> None:
    config = on_device(shipped(DEFAULT, bench.scope.overrides), CPU)
    with SharedStages.open() as shared:
        for rank in (0, 16, 20):
            shared.fit(bench, config.override([f"residual.rank={rank}"]))
        assert len(shared.kept) == 2
