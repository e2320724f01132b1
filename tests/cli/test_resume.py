"""`spmm fit` that was stopped anywhere goes on with `--resume` and gives the same bytes."""

from __future__ import annotations

import errno
import itertools
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spmm_torch.cli.main import STOPPED, main
from spmm_torch.fit import cluster
from spmm_torch.fit.search import lobes
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runs import folder
from spmm_torch.runtime.checkpoint import Checkpoint
from spmm_torch.runtime.threads import cpu_threads
from tests.locations import ROOT
from tests.planted.btfs import rough_btf
from tests.planted.runs import save

DIRECTIONS = ring_directions(((0.0, 1), (40.0, 6), (70.0, 8)))
SIDE, CLUSTERS = 6, 4
TEXELS = [f"texels-{k:04d}" for k in range(CLUSTERS)]
STAGES = ["relief", "cluster", "search", *TEXELS, "pictures", "sweep-0", "sweep-1"]
FILES = ["config.yaml", "log.txt", "model.safetensors", "report.html", "report.json"]
SETTINGS = {
    "cluster.count": CLUSTERS,
    "sample.per_cluster": 2,
    "search.models": "[lambertian, ward]",
    "search.max_lobes": 2,
    "search.restarts": 1,
    "search.bank_normals": 8,
    "search.exchanges": 0,
    "search.final_steps": 2,
}
OPTIONS = [
    "--device",
    "cpu",
    "--no-render",
    *(f"--set={key}={value}" for key, value in SETTINGS.items()),
]
# Of the slow test: kills, and the seed of when they come.
KILLS, SEED = 10, 3
LARGE_SIDE, MORE_STAGES = 64, 17
MORE_CLUSTERS = ["--set=cluster.count=12", "--set=sample.per_cluster=1"]
PATIENCE = 300.0


def rough(path: Path, side: int) -> Path:
    """An NPZ of rough texels, `side` by `side`, under 15 x 15 directions."""
    count = len(DIRECTIONS)
    noise = np.random.default_rng(0).random((count, count, side, side, 3), dtype=np.float32)
    cosine = DIRECTIONS[:, 2].numpy()[None, :, None, None, None]
    values = (0.5 + 0.5 * noise) * cosine
    np.savez(path, values=values.astype(np.float16), view=DIRECTIONS, light=DIRECTIONS)
    return path


@pytest.fixture(scope="module", autouse=True)
def one_after_another() -> Iterator[None]:
    """Clusters are fit one at a time, so that it is known what is finished at a stop."""
    with cpu_threads(1):
        yield


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rough(tmp_path_factory.mktemp("input") / "btf.npz", SIDE)


@pytest.fixture(scope="module")
def unbroken(source: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The model of a run that nothing stopped."""
    run = tmp_path_factory.mktemp("unbroken") / "run"
    assert main(["fit", str(source), "-o", str(run), *OPTIONS]) == 0
    return model(run)


def model(run: Path) -> bytes:
    return (run / "model.safetensors").read_bytes()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def state(run: Path) -> list[str]:
    """The finished stages of an unfinished run."""
    folder = run.parent / f".{run.name}.part" / "state"
    return sorted(path.stem for path in folder.glob("*.safetensors"))


def check_complete(run: Path, unbroken: bytes) -> None:
    assert names(run.parent) == [run.name]
    assert names(run) == FILES
    assert model(run) == unbroken


def stop_after(stages: int, patch: pytest.MonkeyPatch) -> None:
    """A run ends as by Ctrl-C once it has kept so many stages."""
    keep, count = Checkpoint._keep, itertools.count(1)

    def keep_then_stop(self: Checkpoint, *arguments: Any) -> None:
        if stages:
            keep(self, *arguments)
        if next(count) >= stages:
            raise KeyboardInterrupt

    patch.setattr(Checkpoint, "_keep", keep_then_stop)


def stopped(source: Path, run: Path, stages: int, *options: str) -> None:
    """Leaves a run that was stopped after so many stages."""
    with pytest.MonkeyPatch.context() as patch:
        stop_after(stages, patch)
        assert main(["fit", str(source), "-o", str(run), *OPTIONS, *options]) == STOPPED


def test_stop_tells_how_to_go_on(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stopped(source, tmp_path / "run", 1)
    shown = capsys.readouterr()
    assert "the same command with --resume" in shown.err.splitlines()[-1]
    assert "Traceback" not in shown.err
    assert shown.out == ""


@pytest.mark.parametrize("stages", range(len(STAGES) + 1))
def test_stop_at_every_border(source: Path, unbroken: bytes, tmp_path: Path, stages: int) -> None:
    run = tmp_path / "run"
    stopped(source, run, stages)
    if stages:
        assert state(run) == sorted(STAGES[:stages])
        assert main(["fit", str(source), "-o", str(run), *OPTIONS]) == 2  # not without --resume
        assert state(run) == sorted(STAGES[:stages])
    else:
        assert names(tmp_path) == []
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    check_complete(run, unbroken)


def test_stop_at_every_border_of_one_run(source: Path, unbroken: bytes, tmp_path: Path) -> None:
    """Again and again, each time one stage further."""
    run = tmp_path / "run"
    for stage in STAGES:
        stopped(source, run, 1, "--resume")
        assert stage in state(run)
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    check_complete(run, unbroken)


def test_memory_and_cache_may_change_meanwhile(
    source: Path, unbroken: bytes, tmp_path: Path
) -> None:
    run = tmp_path / "runs" / "run"
    stopped(source, run, STAGES.index("search") + 1, "--max-memory", "8GB")
    options = ["--resume", "--max-memory", "4GB", "--cache", str(tmp_path / "cache")]
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, *options]) == 0
    check_complete(run, unbroken)
    assert any(name.endswith(".npy") for name in names(tmp_path / "cache"))


def test_report_tells_the_seconds_of_all_processes(source: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    stopped(source, run, 3)
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    seconds = json.loads((run / "report.json").read_text(encoding="utf-8"))["seconds"]
    assert seconds["search"] > 0.0
    assert seconds["total"] >= seconds["cluster"] + seconds["search"] + seconds["select"]
    log = (run / "log.txt").read_text(encoding="utf-8")
    assert log.count("load: done in") == 2  # of both


@pytest.mark.parametrize(
    ("options", "key"),
    [(["--set", "select.min_gain=0.1"], "select.min_gain"), (["--seed", "1"], "seed")],
)
def test_another_setting_is_refused(
    source: Path, tmp_path: Path, options: list[str], key: str, refused: Callable[..., str]
) -> None:
    run = tmp_path / "run"
    stopped(source, run, 1)
    error = refused("fit", source, "-o", run, *OPTIONS, *options, "--resume")
    assert error.startswith(f"the unfinished run of {run} has {key} = ")
    assert state(run) == ["relief"]


def test_a_finished_run_is_only_named(
    source: Path,
    unbroken: bytes,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable[..., str],
) -> None:
    run = tmp_path / "run"
    assert (
        main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    )  # nothing to go on with
    first = capsys.readouterr().out
    monkeypatch.setattr("spmm_torch.fit.fit", lambda *_: pytest.fail("nothing is left to do"))
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    assert capsys.readouterr().out == first == f"{run / 'report.html'}\n"
    check_complete(run, unbroken)
    error = refused("fit", source, "-o", run, *OPTIONS, "--resume", "--seed", "5")
    assert error.startswith(f"the finished run {run} has seed = 0, not 5; ")
    error = refused("fit", "another.npz", "-o", run, *OPTIONS, "--resume")
    assert error.startswith(f"the finished run {run} has the input {source}, not another.npz; ")


def test_a_finished_run_of_other_values_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    """As an unfinished one is; runs without hashes, or with those of other releases, are let be."""
    source, run = save(rough_btf(), tmp_path / "a.npz"), tmp_path / "run"
    command = ["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]
    assert main(command) == 0
    save(rough_btf(seed=4), source)
    error = refused(*command)
    assert error.startswith(f"the finished run {run} has other content of the input")
    with monkeypatch.context() as patch:
        patch.setattr("spmm_torch.runs.fingerprint.__version__", "9.9.9")
        assert main(command) == 0
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    (run / "report.json").write_text(json.dumps(report | {"contents": None}), encoding="utf-8")
    assert main(command) == 0
    save(rough_btf(), source)
    assert main(command) == 0


def full_disk(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("writer", ["write_atomic", "write_report", "write_html"])
def test_full_disk_at_the_end_loses_no_stage(
    source: Path,
    unbroken: bytes,
    tmp_path: Path,
    writer: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = tmp_path / "run"
    stopped(source, run, len(STAGES))
    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(folder, writer, full_disk)
        assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"error: the disk is full at run folder {run} (")
    assert "go on with --resume" in error
    assert state(run) == sorted(STAGES)
    monkeypatch.setattr(cluster, "principal_points", lambda *_: pytest.fail("it is finished"))
    monkeypatch.setattr(lobes, "find_lobes", lambda *_: pytest.fail("it is finished"))
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    check_complete(run, unbroken)


def test_full_disk_in_a_stage(
    source: Path, unbroken: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        write = Path.write_bytes
        patch.setattr(
            Path,
            "write_bytes",
            lambda path, content: full_disk() if "texels" in path.name else write(path, content),
        )
        assert main(["fit", str(source), "-o", str(run), *OPTIONS]) == 2
    assert "go on with --resume" in capsys.readouterr().err.splitlines()[-1]
    assert state(run) == ["cluster", "relief", "search"]
    assert main(["fit", str(source), "-o", str(run), *OPTIONS, "--resume"]) == 0
    check_complete(run, unbroken)


def start(source: Path, run: Path, cache: Path) -> subprocess.Popen[bytes]:
    """A run by a process of its own."""
    command = [sys.executable, "-m", "spmm_torch.fit", str(source), "-o", str(run), *OPTIONS]
    return subprocess.Popen(
        [*command, *MORE_CLUSTERS, "--cache", str(cache), "--resume"],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition() and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.slow
def test_kill_at_ten_random_points(tmp_path: Path) -> None:
    """SIGKILL: half of them spread over the time that a run takes, half over its stages."""
    source, cache = rough(tmp_path / "btf.npz", LARGE_SIDE), tmp_path / "caches"
    run = tmp_path / "unbroken" / "run"
    process = start(source, run, cache / "unbroken")
    wait_for((run.parent / ".run.part").exists, process)
    began = time.monotonic()
    wait_for(run.exists, process)
    duration = time.monotonic() - began
    assert process.wait(PATIENCE) == 0
    generator = random.Random(SEED)
    reached = []
    for kill in range(KILLS):
        other = tmp_path / f"{kill}" / "run"
        process = start(source, other, cache / f"{kill}")
        wait_for((other.parent / ".run.part").exists, process)
        share = (kill // 2 + generator.random()) / (KILLS // 2)
        if kill % 2:
            wait_for(lambda other=other, n=share * MORE_STAGES: len(state(other)) >= n, process)
            time.sleep(generator.random() * duration / MORE_STAGES)
        else:
            time.sleep(share * duration)
        process.kill()
        process.wait(PATIENCE)
        reached.append("all" if other.exists() else len(state(other)))
        assert start(source, other, cache / f"{kill}").wait(PATIENCE) == 0
        check_complete(other, model(run))
    assert len(set(reached)) >= 4, f"the kills came too much alike: {reached}"
