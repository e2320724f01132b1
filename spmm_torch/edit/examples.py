"""The packaged edit scripts: those of the paper's figures."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from ..errors import ConfigError
from .options import nearest
from .script import Script


def packaged() -> dict[str, Path]:
    """The example scripts by their names."""
    folder = Path(str(resources.files("spmm_torch.configs"))) / "edits"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def script_path(name: str) -> Path:
    """The script file of a path, or of the name of a packaged one, with or without `.yaml`.

    Raises:
        ConfigError: neither exists.
    """
    if Path(name).is_file():
        return Path(name)
    known = packaged()
    found = known.get(name.removesuffix(".yaml"))
    if found is None:
        raise ConfigError(
            f"edit script {name} does not exist; expected a file or the name of an example; "
            f"{nearest(name, known)}"
        )
    return found


def example(name: str) -> Script:
    """A packaged script by its name.

    Raises:
        ConfigError: there is none of this name.
    """
    return Script.read(script_path(name))
