"""Settings that ship with the package, which a name such as `fast` stands for."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ..errors import ConfigError
from .fit import FitConfig

SUFFIX = ".yaml"


def shipped_names() -> list[str]:
    """The names of the settings that ship: `default` for configs/default.yaml."""
    every = (Path(item.name) for item in files("spmm_torch.configs").iterdir())
    return sorted(item.stem for item in every if item.suffix == SUFFIX)


def shipped(name: str, overrides: tuple[str, ...] = ()) -> FitConfig:
    """The settings of `configs/NAME.yaml` with some overrides.

    Raises:
        ConfigError: an override is no setting, or out of its range.
    """
    return FitConfig.from_yaml(_place(name)).override(list(overrides))


def settings_of(text: str) -> FitConfig:
    """The settings in a YAML file, or those that ship under a name, from whatever folder.

    `fast`, `fast.yaml` and `configs/fast.yaml` are the same where no such file is.

    Raises:
        ConfigError: neither a file nor a name, not valid YAML, or not valid settings.
    """
    path, known = Path(text), shipped_names()
    if not path.exists():
        named = path.suffix in ("", SUFFIX) and path.parent in (Path(), Path("configs"))
        if named and path.stem in known:
            return shipped(path.stem)
        raise ConfigError(
            f"settings file {text} cannot be read (there is none); expected a YAML file, or one of "
            f"the names {', '.join(known)}."
        )
    return FitConfig.from_yaml(path)


def _place(name: str) -> Path:
    return Path(str(files("spmm_torch.configs") / f"{name}{SUFFIX}"))
