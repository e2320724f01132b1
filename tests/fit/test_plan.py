"""The estimate grows with the work, and a limit that is too low is told before any of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spmm_torch import BTF, ConfigError, FitConfig
from spmm_torch.brdf import PAPER_MODELS
from spmm_torch.cli.main import main
from spmm_torch.data.store import Loading, Part, Store
from spmm_torch.fit import plan
from spmm_torch.fit.pipeline import fit
from spmm_torch.fit.plan import Plan, estimate
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.memory import Budget

CPU = torch.device("cpu")
HELD, SPEED = 300_000_000, 1e11
GB = 10**9


@pytest.fixture(autouse=True)
def one_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates of one and the same machine and process."""
    monkeypatch.setattr(plan, "_speed", lambda device: SPEED)
    monkeypatch.setattr(plan, "held_memory", lambda: HELD)


def never(part: Part, loading: Loading) -> Store:
    pytest.fail("an estimate must not decode")


def btf(side: int, ring: int, streamed: bool = False, bytes_per_value: float = 1.0) -> BTF:
    """The header of a BTF of `side` x `side` texels and 1 + `ring` directions."""
    directions = ring_directions(((0.0, 1), (60.0, ring)))
    return BTF(
        "btf", "", side, side, directions, directions, bytes_per_value, never, streamed=streamed
    )


SIDES, RINGS = st.integers(1, 512), st.integers(4, 150)
CONFIGS = st.sampled_from(
    [
        FitConfig(),
        FitConfig.from_dict({"search": {"method": "stagewise", "bank_normals": 200}}),
        FitConfig.from_dict({"cluster": {"count": 4}, "sample": {"per_cluster": 2}}),
    ]
)


@given(SIDES, RINGS, CONFIGS)
def test_more_texels_take_longer_and_the_memory_of_what_their_pixels_show(
    side: int, ring: int, config: FitConfig
) -> None:
    """Beside the decoded values, and from where there are more texels than samples."""
    side = max(side, 16)
    small, large = (estimate(btf(s, ring), config, CPU) for s in (side, 2 * side))
    assert small.seconds < large.seconds < 4.001 * small.seconds  # the search stays the same
    assert HELD < small.working_bytes <= large.working_bytes < 4 * small.working_bytes
    assert large.decoded_bytes == 4 * small.decoded_bytes


@given(SIDES, RINGS, RINGS, CONFIGS)
def test_more_directions_take_more_of_both(
    side: int, ring: int, more: int, config: FitConfig
) -> None:
    few, many = (estimate(btf(side, n), config, CPU) for n in (ring, ring + more))
    assert few.seconds < many.seconds
    assert few.working_bytes <= many.working_bytes
    assert few.decoded_bytes < many.decoded_bytes


@given(SIDES, RINGS)
def test_more_work_asked_for_takes_longer(side: int, ring: int) -> None:
    source = btf(max(side, 16), ring)
    config = FitConfig().override(["search.bank_normals=64"])  # else finer for few samples
    base = estimate(source, config, CPU)
    for change in ("search.max_lobes=8", "cluster.components=64"):
        assert estimate(source, config.override([change]), CPU).seconds > base.seconds
    fewer = config.override(["sample.per_cluster=1", "cluster.count=2"])
    assert estimate(source, fewer, CPU).working_bytes <= base.working_bytes


def test_a_small_input_needs_little() -> None:
    """16 x 16 texels fit where torch itself has room, and thousands of lights are no burden."""
    need = estimate(btf(16, 8), FitConfig(), CPU).working_bytes - HELD
    assert need < 80_000_000
    held = 200_000_000  # of a process that has loaded its modules
    assert Budget.build(300_000_000).needing(held + need).spare >= 0
    lights = ring_directions(((0.0, 1), (30.0, 2000), (60.0, 6000)))
    rti = BTF("rti", "", 16, 16, lights[:1], lights, 1.0, never)
    assert estimate(rti, FitConfig(), CPU).working_bytes - HELD < 1_000_000_000


def test_relief_and_refit_count_where_there_can_be_any() -> None:
    """Each view holds some 84 bytes for each pixel, where a relief shows several texels in it."""
    source = btf(400, 80)
    flat = FitConfig().override(["relief.mode=off"])
    plain = flat.override(["residual.rank=0", "storage.weights=float32"])
    bare, refit, mixed = (
        estimate(source, config, CPU).working_bytes for config in (plain, flat, FitConfig())
    )
    each_pixel = source.texel_count * len(source.view)
    assert bare < refit < mixed
    assert mixed - refit > 60 * each_pixel
    assert mixed > HELD + 84 * each_pixel


def test_ggx_counts_where_the_data_may_ask_for_it() -> None:
    """Its candidates join those of the paper's models once the data are decoded."""
    source = btf(4, 80)
    eight = f"search.models=[{','.join((*PAPER_MODELS, 'ggx'))}]"

    def need(*changes: str) -> int:
        return estimate(source, FitConfig().override(list(changes)), CPU).working_bytes

    assert need() == need(eight)
    assert need("weights.error=l2") < need("weights.error=l2", eight)


def test_every_texel_may_choose_from_a_shared_dictionary() -> None:
    """Where no pilot chooses for all, and a dictionary of all clusters is none of one."""
    source, base = btf(128, 40), FitConfig().override(["cluster.count=4", "select.pilot=null"])
    flat = base.override(["relief.mode=off", "residual.rank=0", "storage.weights=float32"])
    many = flat.override(["sample.per_cluster=256"])

    def need(config: FitConfig, scope: str) -> int:
        return estimate(source, config.override([f"dictionary.scope={scope}"]), CPU).working_bytes

    assert need(many, "shared") > 2 * need(many, "cluster")


def test_data_that_may_be_glossy_count_their_weights() -> None:
    source = btf(32, 80)
    flat = FitConfig().override(["relief.mode=off", "residual.rank=0", "sample.per_cluster=256"])
    plain = flat.override(["weights.error=l2"])
    assert estimate(source, plain, CPU).working_bytes < estimate(source, flat, CPU).working_bytes


def test_streamed_values_are_neither_decoded_nor_kept() -> None:
    kept, streamed = (estimate(btf(400, 80, s), FitConfig(), CPU) for s in (False, True))
    assert streamed.decoded_bytes == 0
    assert streamed.seconds < kept.seconds
    assert streamed.working_bytes == kept.working_bytes


@pytest.mark.parametrize("bits", [1.0, 4 / 3, 2.0, 4.0])
def test_decoded_values_keep_their_own_bits(bits: float) -> None:
    source = btf(64, 9, bytes_per_value=bits)
    assert estimate(source, FitConfig(), CPU).decoded_bytes == source.raw_bytes
    assert source.raw_bytes == round(64 * 64 * 100 * 3 * bits)


@pytest.mark.parametrize(
    ("spare", "cached", "memory", "disk"),
    [(4 * GB, False, "5.0", "0.0"), (GB, False, "2.0", "3.0"), (4 * GB, True, "2.0", "3.0")],
)
def test_text(spare: int, cached: bool, memory: str, disk: str) -> None:
    """Decoded values lie in memory where they fit, unless they are wanted on disk."""
    budget = Budget(2 * GB + spare, working=2 * GB)
    text = Plan(185.0, 2 * GB, 3 * GB).describe(budget, cached)
    assert Plan(185.0, 2 * GB, 3 * GB).kept_bytes(budget, cached) == 3 * GB * (disk == "0.0")
    assert text == (
        f"estimate: 3 min 05 s, {memory} GB of memory (allowed: {budget.total / GB:.1f} GB), "
        f"{disk} GB of disk for decoded values"
    )


def test_low_limit_is_told_before_decoding() -> None:
    with pytest.raises(ConfigError, match=r"--max-memory is 0\.00 GB, but this input needs"):
        fit(btf(4, 6), FitConfig.from_dict({"device": "cpu"}), Context.build("cpu", memory=1000))


def test_low_limit_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directions = ring_directions(((0.0, 1), (60.0, 4))).numpy()
    values = np.ones((5, 5, 2, 2, 3), np.float32)
    np.savez(tmp_path / "btf.npz", values=values, view=directions, light=directions)
    run = tmp_path / "out" / "run"
    assert main(["fit", str(tmp_path / "btf.npz"), "-o", str(run), "--max-memory", "1KB"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: --max-memory is 0.00 GB, but this input needs ")
    assert error.count("\n") == 1  # not even the first stage was begun
    assert [path.name for path in tmp_path.iterdir()] == ["btf.npz"]


def test_the_probe_of_this_machine_is_plausible(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert 1e8 < plan._speed(CPU) < 1e15
    assert estimate(btf(4, 6), FitConfig(), CPU).working_bytes > plan.held_memory() > 0
