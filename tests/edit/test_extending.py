"""The worked example of the documentation, run as it stands."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from types import ModuleType

import pytest
import yaml

from spmm_torch import SPMM
from spmm_torch.edit import EDITS, MASKS, Script
from tests.edit.looks import check_valid
from tests.locations import DOCS

TITLE = "An edit, a mask"
FILE = re.compile(r"^New file `(\S+)\.py`:\n\n```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r'^\+    "(\w+)": (\w+),$', re.MULTILINE)
SCRIPT = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def section() -> str:
    """The section of the example."""
    page = (DOCS / "extending.md").read_text(encoding="utf-8")
    return page.split(f"\n## {TITLE}\n")[1].split("\n## ")[0]


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> dict[str, ModuleType]:
    """The files of the example as modules by their dotted names, with its entries made."""
    text, made = section(), {}
    for path, source in FILE.findall(text):
        name = path.replace("/", ".")
        module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, None))
        monkeypatch.setitem(sys.modules, name, module)
        exec(compile(source, path, "exec"), vars(module))
        made[name] = module
    for name, kind in ENTRY.findall(text):
        owner = next(module for module in made.values() if hasattr(module, kind))
        registry = EDITS if ".edits." in owner.__name__ else MASKS
        monkeypatch.setitem(registry, name, getattr(owner, kind))
    return made


def test_its_tests_pass(modules: dict[str, ModuleType], model: SPMM) -> None:
    tests: list[Callable[[SPMM], None]] = [
        value
        for name, module in modules.items()
        for key, value in vars(module).items()
        if name.startswith("tests.") and key.startswith("test_")
    ]
    assert len(tests) == 2
    for test in tests:
        test(model)


@pytest.mark.usefixtures("modules")
def test_its_script_runs(model: SPMM) -> None:
    found = SCRIPT.search(section())
    assert found is not None
    script = Script.parse(yaml.safe_load(found[1]))
    assert {step.name for step in script.steps} == {"warmth"}
    edited = script.apply(model)
    assert edited.pack() != model.pack()
    check_valid(edited)
