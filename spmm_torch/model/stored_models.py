"""Which BRDFs a model file names, and how many of their parameters it keeps.

Readers of format 1 know the first eight. A file names those and goes on to the last one in use, so
a model that is added to the registry changes no file that does not use it, and such a file can be
read by programs that do not know it.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY

FORMAT_1_MODELS = 8


def stored_names(model: Tensor) -> tuple[str, ...]:
    """Names of the BRDFs that a file lists, given those of its lobes `model [J]`."""
    used = int(model.max()) + 1 if len(model) else 0
    return MODEL_NAMES[: max(FORMAT_1_MODELS, used)]


def stored_kappa(kappa: Tensor, names: tuple[str, ...]) -> Tensor:
    """The columns `[J, P]` of kappa `[J, MAX_PARAMETERS]` that the BRDFs of a file have."""
    return kappa[:, : max(len(brdf.parameters) for brdf in REGISTRY[: len(names)])]


def loaded_kappa(kappa: Tensor) -> Tensor:
    """Kappa `[J, MAX_PARAMETERS]` of the columns `[J, P]` of a file."""
    return pad(kappa, (0, MAX_PARAMETERS - kappa.shape[1]))


def loaded_models(model: Tensor, names: list[str]) -> Tensor:
    """Indices `[J]` into `MODEL_NAMES` of indices `model [J]` into the names of a file.

    Raises:
        ValueError: a lobe uses a BRDF that is not known, or has no name.
    """
    model = model.long()
    for index in torch.unique(model).tolist():
        if index >= len(names) or names[index] not in MODEL_NAMES:
            found = names[index] if index < len(names) else f"number {index}"
            raise ValueError(f"BRDF {found}; known: {', '.join(MODEL_NAMES)}")
    known = [MODEL_NAMES.index(name) if name in MODEL_NAMES else -1 for name in names]
    return torch.tensor(known, dtype=torch.long, device=model.device)[model]
