"""The API reference as HTML pages, by pdoc: `make docs`."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import inspect
import pkgutil
import sys
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pdoc

import spmm_torch

# `cli` and `viz` lie beside `spmm_torch` in a checkout, so a walk from it misses them.
ROOTS = ("spmm_torch", "spmm_torch.cli", "spmm_torch.viz")
# pdoc does not find the types of a NamedTuple's fields, and shows their names instead.
HARMLESS = r"Error parsing type annotation ForwardRef\("
# Nor where a subclass of a tensor has some members from.
OF_TENSORS = r"Cannot determine where .*\.DeviceTensor\._is_param is taken from"


def module_names() -> Iterator[str]:
    """The dotted names of all modules, `__main__` left out."""
    for root in ROOTS:
        yield root
        package = importlib.import_module(root)
        for module in pkgutil.walk_packages(package.__path__, f"{root}."):
            if not module.name.endswith(".__main__"):
                yield module.name


def specifications() -> list[str]:
    """What pdoc must be given: it walks a package itself, but for modules not in `__all__`."""
    given, reached = [], set()
    for name in sorted(set(module_names())):
        if name not in reached:
            given.append(name)
            reached.update(pdoc.extract.walk_specs([name]))
    return given


def load(names: Iterable[str]) -> None:
    """Imports modules and all that they hand on, some of which only when it is asked for."""
    for name in names:
        module = importlib.import_module(name)
        for public in getattr(module, "__all__", ()):
            setattr(module, public, getattr(module, public))


def resolve_constructors(names: Iterable[str]) -> None:
    """Evaluates the annotations of constructors of dataclasses where their fields are written.

    pdoc evaluates them where the class is, which need not import what its base classes name.
    """
    for name in names:
        for found in list(vars(importlib.import_module(name)).values()):
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                constructor = found.__init__.__annotations__
                for owner in found.__mro__[1:]:
                    known = vars(sys.modules[owner.__module__])
                    for field in inspect.get_annotations(owner).keys() & constructor.keys():
                        if isinstance(constructor[field], str):
                            constructor[field] = evaluated(constructor[field], known)


def evaluated(annotation: str, known: dict[str, Any]) -> Any:
    """What an annotation names, or the annotation itself where that is known to checkers alone."""
    try:
        return eval(annotation, known)  # of our own source
    except NameError:
        return annotation


def build(output: Path) -> None:
    """Writes a page for each module, an index and a search; any warning is an error."""
    load(module_names())
    resolve_constructors(module_names())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", HARMLESS)
        warnings.filterwarnings("ignore", OF_TENSORS)
        pdoc.render.configure(
            docformat="google",
            footer_text=f"spmm_torch {spmm_torch.__version__}",
            template_directory=Path(__file__).parent,
        )
        pdoc.pdoc(*specifications(), output_directory=output)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, help="folder to write")
    output = parser.parse_args().output
    build(output)
    print(f"The API reference lies in {output / 'index.html'}")


if __name__ == "__main__":
    main()
