"""An editing session without a screen: layers of edits, undo and redo, the edited model, saving."""

from __future__ import annotations

import os
import shutil
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
import yaml

from ...config.written import load_text
from ...edit import Mask, Script, Step, lobe_group
from ...errors import ConfigError
from ...model.spmm import SPMM
from ...runs.edited import save_edited_run, taken_apart
from ...runtime.atomic import output_errors
from .layers import Layer, Layers, layers_of
from .sliders import BY_NAME, NEUTRAL, RELIEF, SLIDERS, Slider

# Kept models of the first edits of a script; a slider then costs its own edit only.
KEPT_MODELS = 24


@dataclass
class Session:
    """The state of an editor; every change of it can be undone.

    Args:
        run: folder or model file that is edited.
        original: its model.
        layers: edits; the last layer is the one that sliders change.
    """

    run: Path
    original: SPMM
    layers: Layers = (Layer(),)
    _undo: list[Layers] = field(default_factory=list)
    _redo: list[Layers] = field(default_factory=list)
    _dragged: str | None = None
    _saved: set[Path] = field(default_factory=set)
    _models: OrderedDict[tuple[Step, ...], SPMM] = field(default_factory=OrderedDict)

    @classmethod
    def open(cls, run: Path | str, device: torch.device | str = "cpu") -> Session:
        """A session on a run; the edits of an edited one can be moved and undone where it stopped.

        Raises:
            OutputError: the run cannot be read.
        """
        model = SPMM.load(run, device).requires_grad_(False)
        earlier = taken_apart(run, model, device)
        if earlier is None:
            return cls(Path(run), model)
        layers = layers_of(earlier.script.steps)
        before = [(Layer(),), *(layers[:count] for count in range(1, len(layers)))]
        return cls(earlier.run, earlier.original, layers, _undo=before)

    @property
    def script(self) -> Script:
        """All edits."""
        return Script(tuple(step for layer in self.layers for step in layer.steps))

    @property
    def values(self) -> dict[str, float]:
        """The value of every slider."""
        return NEUTRAL | dict(self.layers[-1].values)

    @property
    def mask(self) -> Mask | None:
        """The selection."""
        return self.layers[-1].mask

    @property
    def can_undo(self) -> bool:
        """Whether there is something to undo."""
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        """Whether there is something to redo."""
        return bool(self._redo)

    def move(self, name: str, value: float) -> None:
        """Moves a slider; until `release`, moves of the same one are undone together.

        Raises:
            ConfigError: no such slider, or out of its range.
        """
        slider = BY_NAME.get(name)
        if slider is None:
            raise ConfigError(f"unknown slider {name}; expected one of {', '.join(BY_NAME)}.")
        if not slider.low <= value <= slider.high:
            raise ConfigError(
                f"{name} is {value}; expected a value from {slider.low:g} to {slider.high:g}."
            )
        layers = (*self.layers[:-1], self.layers[-1].with_values({name: float(value)}))
        if layers == self.layers:
            return
        if self._dragged == name:
            self.layers = layers
        else:
            self._set(layers)
            self._dragged = name

    def release(self) -> None:
        """Ends a drag: the next move is undone by itself."""
        self._dragged = None

    def select(self, mask: Mask | None) -> None:
        """Selects where sliders act from now on; edits that were made stay where they are."""
        top = self.layers[-1]
        if mask == top.mask:
            return
        kept = self.layers if top.steps else self.layers[:-1]
        self._set((*kept, Layer(mask)))

    def add(self, text: str) -> None:
        """Adds an edit as scripts write it, `replace_model: {name: ward}`, in the selection.

        Raises:
            ConfigError: not a valid edit.
            SPMMError: the edit cannot be done.
        """
        steps = tuple(
            step if step.mask is not None else replace(step, mask=self.mask)
            for step in Script.parse(_items(text)).steps
        )
        top = self.layers[-1]
        layers = (*self.layers[:-1], replace(top, typed=top.typed + steps), Layer(self.mask))
        Script(tuple(step for layer in layers for step in layer.steps)).apply(self.original)
        self._set(layers)

    def undo(self) -> None:
        """Takes the last change back, if there is one."""
        self._turn_back(self._undo, self._redo)

    def redo(self) -> None:
        """Makes the last change again that was taken back, if there is one."""
        self._turn_back(self._redo, self._undo)

    def reset(self) -> None:
        """Takes all edits away, which can be undone as well."""
        if self.layers != (Layer(),):
            self._set((Layer(),))

    def model(self) -> SPMM:
        """The edited model; edits before the one that changed are not applied again.

        Raises:
            SPMMError: an edit cannot be done.
        """
        steps = self.script.steps
        known = next(n for n in range(len(steps), -1, -1) if n == 0 or steps[:n] in self._models)
        model = self._models[steps[:known]] if known else self.original
        for count in range(known, len(steps)):
            model = steps[count].apply(model)
            self._models[steps[: count + 1]] = model
        while len(self._models) > KEPT_MODELS:
            self._models.popitem(last=False)
        return model

    def save(self, output: Path | str) -> None:
        """Saves the edited model as a run of its own, with the script that makes it.

        What this session has saved under that name before is replaced. `~` is the user's home.

        Raises:
            SPMMError: an edit cannot be done, or the folder exists or cannot be written.
        """
        if not str(output).strip():
            raise ConfigError("no name to save as; expected a new folder such as RUN2; give one.")
        target = Path(str(output).strip()).expanduser().absolute()
        again = target in self._saved and target.exists()
        place = target.with_name(f".{target.name}.again") if again else target
        save_edited_run(self.run, self.original, self.model(), self.script, place)
        if again:
            with output_errors(target):
                shutil.rmtree(target)
                os.replace(place, target)
        self._saved.add(target)

    def usable(self) -> dict[str, bool]:
        """Whether each slider has something that it can change: its lobes, or the relief."""
        return {slider.name: self._can_change(slider) for slider in SLIDERS}

    def _can_change(self, slider: Slider) -> bool:
        if slider.name == RELIEF:
            return self.original.relief is not None
        try:
            lobe_group(self.original, slider.group or "all")
        except ConfigError:
            return False
        return True

    def _set(self, layers: Layers) -> None:
        """Makes a change that can be undone."""
        self._undo.append(self.layers)
        self._redo.clear()
        self.layers = layers
        self._dragged = None

    def _turn_back(self, source: list[Layers], target: list[Layers]) -> None:
        if source:
            target.append(self.layers)
            self.layers = source.pop()
        self._dragged = None


def _items(text: str) -> list[object]:
    """The list of edits in a text of one or more of them.

    Raises:
        ConfigError: no YAML.
    """
    try:
        items = load_text(text)
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"the edit is not valid YAML: {reason}; mend it.") from error
    return items if isinstance(items, list) else [items]
