"""Which BRDFs a model file names, and how many columns of kappa it stores.

A file names the first eight, which every reader of format 1 knows, and then those up to the last
one in use. A BRDF that is added to the registry thus changes no file that does not use it, and
older programs still read such a file.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..brdf import MAX_PARAMETERS, MODEL_NAMES, REGISTRY

FORMAT_1_MODELS = 8


def stored_names(model: Tensor) -> tuple[str, ...]:
    """Names of the BRDFs that a file lists, given the models of its lobes `[J]`."""
    used = int(model.max()) + 1 if len(model) else 0
    return MODEL_NAMES[: max(FORMAT_1_MODELS, used)]


def stored_kappa(kappa: Tensor, names: tuple[str, ...]) -> Tensor:
    """The columns `[J, P]` of kappa `[J, MAX_PARAMETERS]` that the BRDFs `names` need."""
    return kappa[:, : max(len(brdf.parameters) for brdf in REGISTRY[: len(names)])]


def loaded_kappa(kappa: Tensor) -> Tensor:
    """The columns `[J, P]` of a file, padded to `[J, MAX_PARAMETERS]` with zeros."""
    return pad(kappa, (0, MAX_PARAMETERS - kappa.shape[1]))


def loaded_models(model: Tensor, names: list[str]) -> Tensor:
    """Indices `[J]` into `MODEL_NAMES`, given indices `model [J]` into the names of a file.

    Raises:
        ValueError: the BRDF of a lobe is not known or has no name.
    """
    model = model.long()
    for index in torch.unique(model).tolist():
        if index >= len(names) or names[index] not in MODEL_NAMES:
            found = names[index] if index < len(names) else f"number {index}"
            raise ValueError(f"BRDF {found}; known: {', '.join(MODEL_NAMES)}")
    known = [MODEL_NAMES.index(name) if name in MODEL_NAMES else -1 for name in names]
    return torch.tensor(known, dtype=torch.long, device=model.device)[model]
