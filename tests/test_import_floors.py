"""The floors of the house: imports go downward only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.locations import ROOT

# Where the modules lie, and what they are called once installed.
SOURCES = {"spmm_torch": "spmm_torch", "cli": "spmm_torch.cli", "viz": "spmm_torch.viz"}

# From the ground up. A unit is a module or a package right under spmm_torch; it may import units
# of lower floors and itself, so units of one floor do not know each other. "__init__" is
# spmm_torch/__init__.py, which re-exports what lies below it.
FLOORS: tuple[frozenset[str], ...] = (
    frozenset({"errors", "metrics", "geometry"}),
    frozenset({"runtime", "brdf"}),
    frozenset({"config"}),
    frozenset({"solvers", "data", "lobes"}),
    frozenset({"check", "model", "synthesize"}),
    frozenset({"__init__"}),
    frozenset({"render", "edit", "mitsuba"}),
    frozenset({"report"}),
    frozenset({"runs"}),
    frozenset({"evaluate"}),
    frozenset({"export", "fit", "figures", "viz"}),
    frozenset({"benchmark"}),
    frozenset({"cli"}),
)
# Modules that start a command lie on the floor of the commands, wherever they must be found.
ENTRIES = frozenset({"spmm_torch.fit.__main__"})
LEVEL = {unit: level for level, floor in enumerate(FLOORS) for unit in floor}
# Packages of the extras: imported in the function that needs them, or not at all.
LAZY = frozenset(
    {
        "drjit",
        "flip_evaluator",
        "mitsuba",
        "pyarrow",
        "pyvista",
        "sklearn",
        "trame",
        "trame_pyvista",
        "trame_vtk",
        "trame_vuetify",
        "vtk",
        "vtkmodules",
    }
)


def module_name(path: Path, folder: Path, package: str) -> str:
    """The dotted name of a file under `folder`, which is installed as `package`."""
    parts = list(path.relative_to(folder).with_suffix("").parts)
    if parts[-1] == "__init__":
        parts.pop()
    return ".".join([package, *parts])


def sources() -> dict[str, Path]:
    """Every module of the repository by its dotted name."""
    return {
        module_name(path, ROOT / folder, package): path
        for folder, package in SOURCES.items()
        for path in sorted((ROOT / folder).rglob("*.py"))
    }


def unit_of(module: str) -> str:
    """The unit under spmm_torch that a dotted name belongs to."""
    if module in ENTRIES:
        return "cli"
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def imported(tree: ast.AST, package: str, known: frozenset[str]) -> Iterator[tuple[int, str]]:
    """(line, absolute dotted name) of every import in a tree, those in functions included.

    Args:
        tree: a module's tree, or a part of it.
        package: the package that the module lies in, which relative imports start from.
        known: modules of the repository, to tell `from package import module` from a name.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*(above if node.level else []), *filter(None, [node.module])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield node.lineno, full if full in known else base


def eager(node: ast.AST) -> Iterator[ast.AST]:
    """The imports that run when the module of tree `node` is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from eager(child)


def violations(module: str, is_package: bool, text: str, known: frozenset[str]) -> list[str]:
    """A sentence for each rule that one module breaks."""
    unit = unit_of(module)
    if unit not in LEVEL:
        return [f"{module} has no floor: place '{unit}' in FLOORS of tests/test_import_floors.py."]
    package = module if is_package else module.rpartition(".")[0]
    tree = ast.parse(text)
    found = []
    for line, name in imported(tree, package, known):
        target = unit_of(name)
        if name.split(".")[0] != "spmm_torch" or target == unit:
            continue
        if target not in LEVEL:
            found.append(f"{module}:{line} imports {name}, which has no floor: place '{target}'.")
        elif LEVEL[target] >= LEVEL[unit]:
            found.append(f"{module}:{line} imports {name}, which does not lie on a lower floor.")
    for node in eager(tree):
        for line, name in imported(node, package, known):
            if name.split(".")[0] in LAZY:
                found.append(f"{module}:{line} imports {name} at the top: move it to a function.")
    return found


def test_every_import_goes_downward() -> None:
    modules = sources()
    known = frozenset(modules)
    broken = [
        sentence
        for module, path in modules.items()
        for sentence in violations(
            module, path.name == "__init__.py", path.read_text(encoding="utf-8"), known
        )
    ]
    assert not broken, "\n" + "\n".join(broken)


def test_the_walk_sees_the_modules() -> None:
    modules = sources()
    assert {"spmm_torch", "spmm_torch.geometry.warp", "spmm_torch.brdf.ward"} <= set(modules)


PLANTED = [
    ("spmm_torch.brdf.ward", "from ..solvers import nnls", "not lie on a lower floor"),
    ("spmm_torch.brdf.ward", "from ..lobes.batch import LobeBatch", "not lie on a lower floor"),
    ("spmm_torch.geometry.warp", "from ..lobes.batch import LobeBatch", "not lie on a lower floor"),
    ("spmm_torch.geometry.warp", "import spmm_torch.fit", "not lie on a lower floor"),
    ("spmm_torch.geometry.warp", "from spmm_torch import lobes", "imports spmm_torch.lobes"),
    ("spmm_torch.geometry.warp", "from .. import lobes", "imports spmm_torch.lobes"),
    ("spmm_torch.model.spmm", "from spmm_torch import SPMM", "imports spmm_torch,"),
    ("spmm_torch.render.scene", "def f():\n    from ..fit import fit", "render.scene:2 imports"),
    ("spmm_torch.edit", "def f():\n    import spmm_torch.fit as g", "not lie on a lower floor"),
    ("spmm_torch.edit.command", "from ..viz import app", "not lie on a lower floor"),
    ("spmm_torch.fit.plan", "from ..cli.main import main", "not lie on a lower floor"),
    ("spmm_torch.viz.app", "import pyvista as pv", "at the top"),
    ("spmm_torch.viz.app", "try:\n    from trame.app import x\nexcept ImportError: ...", "at the"),
    ("spmm_torch.novelty", "import math", "place 'novelty'"),
    ("spmm_torch.fit.plan", "from ..novelty import x", "place 'novelty'"),
]


@pytest.mark.parametrize(("module", "text", "complaint"), PLANTED)
def test_a_planted_violation_is_found(module: str, text: str, complaint: str) -> None:
    known = frozenset({"spmm_torch", "spmm_torch.lobes", "spmm_torch.solvers.nnls"})
    found = violations(module, False, text, known)
    assert len(found) == 1
    assert complaint in found[0]


ALLOWED = [
    (
        "spmm_torch.brdf",
        True,
        "from .ward import Ward\nfrom ..geometry import warp",
    ),
    ("spmm_torch.viz.app", False, "def f():\n    import pyvista\n    import mitsuba"),
    ("spmm_torch", True, "from .config.fit import FitConfig\nfrom .data import load_btf"),
    ("spmm_torch.cli.main", False, "from ..fit import fit\nfrom spmm_torch import SPMM"),
    (
        "spmm_torch.fit.search.bank",
        False,
        "from ...solvers import nnls\nfrom .sample import s",
    ),
]


@pytest.mark.parametrize(("module", "is_package", "text"), ALLOWED)
def test_what_is_allowed_passes(module: str, is_package: bool, text: str) -> None:
    assert violations(module, is_package, text, frozenset({"spmm_torch"})) == []
