"""Docstrings: every public function that takes or gives tensors tells their shapes."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.locations import ROOT

FOLDERS = ("spmm_torch", "cli", "viz")
# A shape such as `[T, D, C]`, `[...]`, or `[]` of a scalar; or the place that tells it.
SHAPE = re.compile(r"\[[A-Za-z0-9_.,+*\- ']*\]|see `[A-Z]\w+\.\w+`")
Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, Function]]:
    """(dotted name, function) of the public functions and methods of a module."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node, f"{prefix}{node.name}.")
        elif isinstance(node, Function) and not node.name.startswith("_"):
            yield f"{prefix}{node.name}", node


def has_tensors(function: Function) -> bool:
    """Whether an argument or the result is annotated as a tensor, or holds some."""
    arguments = function.args
    every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    annotations = [argument.annotation for argument in every] + [function.returns]
    names = (node for part in annotations if part is not None for node in ast.walk(part))
    return any(isinstance(node, ast.Name) and node.id == "Tensor" for node in names)


def complaint(function: Function) -> str | None:
    """What a function's docstring lacks."""
    text = ast.get_docstring(function)
    if text is None:
        return "has no docstring"
    if has_tensors(function) and SHAPE.search(text) is None:
        return "tells no shape of its tensors"
    return None


def complaints(text: str) -> list[str]:
    """One sentence for each public function whose docstring lacks something."""
    found = ((name, complaint(node)) for name, node in public_functions(ast.parse(text)))
    return [f"{name} {what}" for name, what in found if what]


def test_every_public_function_tells_the_shapes_of_its_tensors() -> None:
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    lacking = [
        f"{path.relative_to(ROOT)}: {sentence}"
        for path in files
        for sentence in complaints(path.read_text(encoding="utf-8"))
    ]
    assert not lacking, f"{len(lacking)} functions:\n" + "\n".join(lacking)


PLANTED = {
    'def f(x: Tensor) -> None:\n    """Takes x."""': ["f tells no shape of its tensors"],
    'def f() -> tuple[Tensor, int]:\n    """Gives x."""': ["f tells no shape of its tensors"],
    "def f() -> int:\n    return 1": ["f has no docstring"],
    'class A:\n    def f(self, *, x: "Tensor | None") -> None: ...': ["A.f has no docstring"],
    'def f(x: Tensor) -> Tensor:\n    """Doubles x `[T, 3]`."""': [],
    'def f(x: Tensor) -> Tensor:\n    """The scalar `[]`."""': [],
    'def f(x: Tensor) -> Tensor:\n    """The density; see `BRDF.pdf`."""': [],
    "def _f(x: Tensor) -> Tensor: ...": [],
    "class _A:\n    def f(self) -> Tensor: ...": [],
}


@pytest.mark.parametrize(("text", "expected"), PLANTED.items())
def test_what_is_planted_is_found(text: str, expected: list[str]) -> None:
    assert complaints(text) == expected
