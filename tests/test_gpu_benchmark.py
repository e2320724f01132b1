"""`python -m tests.benchmarks.gpu` ends in time, goes on after failures, says what is missing."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.benchmarks import gpu
from tests.benchmarks.on_gpu import needs, schedule
from tests.benchmarks.on_gpu.child import Ended, run_child
from tests.benchmarks.on_gpu.rows import Row, read, writer
from tests.locations import ROOT

ROW = '{"name": "half", "seconds": 1.0}'
WRITE = f"import sys, time; open(sys.argv[-1], 'w').write('{ROW}\\n' + '{{\"name\": \"cut o'); "


def command(code: str) -> tuple[str, ...]:
    """A process that writes one row and the beginning of another, then runs some code."""
    return (sys.executable, "-S", "-c", WRITE + code)


def test_a_part_that_fails_keeps_its_rows() -> None:
    found = run_child([], 60.0, command("raise RuntimeError('CUDA error: launch failed')"))
    assert found.rows == [Row("half", 1.0)]
    assert found.failure == "exit code 1: RuntimeError: CUDA error: launch failed"
    assert "Traceback" in found.said


@pytest.mark.parametrize("deaf", [False, True])
def test_a_part_that_hangs_is_ended(deaf: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.benchmarks.on_gpu.child.GRACE", 0.4)
    code = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); " if deaf else ""
    start = time.monotonic()
    found = run_child([], 2.0, command(code + "time.sleep(600)"))
    assert time.monotonic() - start < 300
    assert found.rows == [Row("half", 1.0)] and found.failure == "ended after its 2 s"


def test_nothing_is_begun_without_time() -> None:
    assert run_child(["speed"], 1.0) == Ended([], 0.0, "not begun: out of time")


def test_limits_sum_up_to_less_than_six_minutes() -> None:
    parts, spent = list(schedule.LIMITS), 0.0
    for number, part in enumerate(parts):
        limit = schedule.seconds_for(parts[number:], spent)
        assert limit >= schedule.LIMITS[part]
        spent += limit
    assert spent + schedule.GRACE + schedule.WRITING <= 360
    assert schedule.seconds_for(["speed"], 400.0) == 0.0


def test_a_later_row_replaces_an_earlier_one(tmp_path: Path) -> None:
    put = writer(tmp_path / "rows")
    for row in (Row("a", 1.0), Row("b"), Row("a", 1.0, flops=2.0)):
        put(row)
    assert read(tmp_path / "rows") == [Row("a", 1.0, flops=2.0), Row("b")]


def test_it_goes_on_after_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = {
        "speed": Ended([Row("copy", 0.5, bytes=1e9), Row("matrix product, float32", 1.0, 4e12)], 9),
        "sample": Ended([Row("sample: search", 1.0, 1e12, 1e9, 5_000_000)], 9.0, "ended", "here"),
    }
    monkeypatch.setattr(gpu, "run_child", lambda words, limit: ended[words[0]])
    words = ["-o", str(tmp_path / "out"), "--device", "cpu", "--parts", "sample,speed"]
    assert gpu.main(words) == gpu.FAILED
    results = json.loads((tmp_path / "out" / gpu.RESULTS).read_text(encoding="utf-8"))
    assert list(results["parts"]) == ["speed", "sample"]
    assert results["parts"]["sample"]["rows"][0]["flops"] == 1e12
    assert results["parts"]["sample"]["said"] == "here"
    printed = capsys.readouterr().out
    assert "sample FAILED: ended" in printed and results["environment"]["device"] in printed
    line = next(line for line in printed.splitlines() if line.startswith("sample: search"))
    assert line.split() == ["sample:", "search", "1", "1.000", "25.0", "%", "1.0", "50.0", "%", "5"]
    assert gpu.main(words) == gpu.BAD_INPUT  # the folder is there


def test_what_is_missing_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(needs, "find_spec", lambda name: None if name in ("yaml", "PIL") else name)
    assert gpu.main(["-o", "nowhere"]) == gpu.BAD_INPUT
    said = capsys.readouterr().err
    assert said == "packages are missing: pyyaml pillow; install them with pip.\n"
    monkeypatch.undo()
    assert "--device cpu" in (needs.missing("cuda") or "--device cpu")


def test_an_unknown_part() -> None:
    with pytest.raises(SystemExit, match="'triple'; expected some of speed, agreement"):
        gpu.main(["-o", "nowhere", "--device", "cpu", "--parts", "triple"])


# Packages of the project that a bare machine may lack, taken away before anything is imported.
BARE = """
import importlib.metadata as metadata, sys
own = {"numpy", "scipy", "PyYAML", "safetensors", "tqdm", "pillow", "filelock", "Jinja2",
       "MarkupSafe", "torch", "setuptools"}
needed = {"mpmath", "sympy", "networkx", "fsspec", "typing_extensions"}
for module, owners in metadata.packages_distributions().items():
    if not set(owners) & (own | needed) and module not in {"tests", *sys.modules}:
        sys.modules.setdefault(module, None)
# Of those that are one compiled file the metadata may not tell the name.
for name in ("kornia", "imagecodecs", "OpenEXR", "platformdirs", "skimage"):
    assert sys.modules.setdefault(name, None) is None
from tests.benchmarks import gpu
sys.modules.pop("spmm_torch", None)
for name in ("sample", "training"):
    from tests.benchmarks.on_gpu import child
    child.main(name, "cpu", "small", sys.argv[1])
"""


@pytest.mark.slow
def test_it_runs_without_an_installation(tmp_path: Path) -> None:
    """With the packages that it names and no others, from a checkout that pip does not know."""
    words = [sys.executable, "-W", "ignore", "-c", BARE, str(tmp_path / "rows")]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = [row.name for row in read(tmp_path / "rows")]
    assert "sample: total" in names and names[-1] == "training step, 100 triples"


@pytest.mark.slow
def test_the_dry_run(tmp_path: Path) -> None:
    """Every part in its own process, small and on the CPU."""
    words = ["-m", "tests.benchmarks.gpu", "-o", str(tmp_path / "out"), "--device=cpu", "--small"]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "FAILED" not in done.stdout and "% of lobes the same" in done.stdout
