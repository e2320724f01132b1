"""What a model holds: lobes, weights of all texels, residual and relief; and its file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Self

import torch
from torch import Tensor, nn

from ..brdf import MODEL_NAMES
from ..errors import OutputError
from ..geometry.grazing import lowest_cosine
from ..geometry.relief import steepest
from ..lobes.batch import LobeBatch
from ..lobes.sampling import LobeTable, lobe_intensity, specular_mask
from ..runtime import tensor_file
from ..runtime.atomic import new_file
from ..runtime.device import plain_torch
from . import bounds, file
from .components import Components
from .lookup import SparseWeights
from .relief import STEEPEST, Relief
from .residual import Residual


class Mixture(nn.Module):
    """T = H x W texels, each a short non-negative sum of J shared lobes, plus a residual.

    alpha, kappa, normals, angles and epsilon of [WDR11 Eq. 2] are parameters of the module; epsilon
    starts without gradient. With components, sum_r c_r B_r(wi, wo) is added to epsilon, or is all
    of it. `SPMM` evaluates it.

    Args:
        height, width: texels of the texture, H and W.
        lobes: the dictionary, J lobes.
        weights: entries of all texels.
        labels: cluster of each texel, `[T]`.
        residual: epsilon_k of each cluster; it may have no clusters.
        light, view: measured directions `[L, 3]`, `[V, 3]`.
        name: of the material.
        components: the residual of each texel; None for none.
        weight_type: number format of the weights in a file: uint8, int16 or float32.
        relief: heights of the surface; None: it is flat, and the texture repeats.
    """

    lobe_model: Tensor
    offset: Tensor
    index: Tensor
    labels: Tensor
    light: Tensor
    view: Tensor

    def __init__(
        self,
        height: int,
        width: int,
        lobes: LobeBatch,
        weights: SparseWeights,
        labels: Tensor,
        residual: Residual,
        light: Tensor,
        view: Tensor,
        name: str = "",
        components: Components | None = None,
        weight_type: torch.dtype = torch.float32,
        relief: Relief | None = None,
    ) -> None:
        super().__init__()
        self.height, self.width, self.name = height, width, name
        self.weight_type = weight_type
        self.horizon, self.lowest_light = lobes.horizon, lowest_cosine(light)
        self.kappa = nn.Parameter(lobes.kappa)
        self.normal = nn.Parameter(lobes.normal)
        self.angle = nn.Parameter(lobes.angle)
        self.weight = nn.Parameter(weights.weight)
        self.register_buffer("lobe_model", lobes.model, persistent=False)
        self.register_buffer("offset", weights.offset)
        self.register_buffer("index", weights.index)
        self.register_buffer("labels", labels)
        self.residual = residual
        self.components = components
        self.relief = relief
        self.register_buffer("light", light)
        self.register_buffer("view", view)
        self._keep_structure()
        self.register_load_state_dict_post_hook(Mixture._keep_structure)

    @classmethod
    def load(cls, run: Path | str, device: torch.device | str = "cpu") -> Self:
        """The model of a run folder, or of a `model.safetensors` file.

        Raises:
            OutputError: there is no model, not one of a version that this program reads, or one
                whose numbers are not valid, such as NaN.
        """
        tensors, metadata = tensor_file.read(run, device)
        try:
            model = cls.from_tensors(tensors, metadata)
        except (KeyError, ValueError) as error:
            raise OutputError(
                f"{run} lacks a part of the model or names an unknown BRDF ({error}); expected a "
                f"model of spmm fit; fit it again."
            ) from error
        if (flaw := bounds.flaw(model)) is not None:
            raise OutputError(f"{run} holds no valid model: {flaw}; fit or train it again.")
        return model

    def save(self, path: Path | str) -> None:
        """Writes the model file, whole or not at all, for `load`.

        Args:
            path: of the file, or of a folder, which then holds `model.safetensors`.

        Raises:
            OutputError: the file cannot be written, or the model is not valid; see `project_`.
        """
        target, content = Path(path), self.pack()
        with new_file(target / tensor_file.MODEL_FILE if target.is_dir() else target) as temporary:
            temporary.write_bytes(content)

    def pack(self) -> bytes:
        """The content of a model file.

        Raises:
            OutputError: the model is not valid; see `project_`.
        """
        if (flaw := bounds.flaw(self)) is not None:
            raise OutputError(
                f"the model {self.name!r} is not valid: {flaw}; expected finite numbers, weights "
                f"from 0 and unit normals; call project_() after each step of training."
            )
        return tensor_file.pack(*self.to_tensors())

    def project_(self) -> Self:
        """Takes the parameters to the nearest valid ones, in place; returns the model.

        Weights are not below 0, normals are unit and within 85 degrees of z, kappa is in the range
        of its BRDF. For the end of each step of training, which knows nothing of these bounds.
        """
        bounds.project(self)
        return self

    def requires_grad_lobes(self, requires_grad: bool = True) -> Self:
        """Trains the lobes (kappa, normals and angles), or freezes them; returns the model.

        Weights, the residual and the relief stay as they are: `model.weight.requires_grad_(False)`
        freezes weights. In float32 codes, the residual can be trained, too.

        Args:
            requires_grad: whether autograd records what is done with the lobes.
        """
        for part in (self.kappa, self.normal, self.angle):
            part.requires_grad_(requires_grad)
        return self

    def to_tensors(self) -> tuple[dict[str, Tensor], dict[str, str]]:
        """Tensors of a model file by name, and its metadata; see `file.to_tensors`.

        Shapes are those of the module: `weights.index [N]`, `dictionary.normal [J, 3]` and others.
        """
        parts = file.ModelParts(
            self.height,
            self.width,
            self.dictionary,
            self.sparse_weights,
            self.labels,
            self.residual,
            self.light,
            self.view,
            self.name,
            components=self.components,
            weight_type=self.weight_type,
            relief=self.relief,
        )
        return file.to_tensors(parts)

    @classmethod
    @plain_torch()
    def from_tensors(cls, tensors: dict[str, Tensor], metadata: dict[str, str]) -> Self:
        """The model of tensors and metadata; see `SPMM.to_tensors`.

        Raises:
            KeyError: a tensor or a key of the metadata is missing.
            ValueError: a BRDF is not known, or a height or width is not a number.
        """
        # What was read in inference mode could have no gradients, and be no parameter here.
        plain = {name: x.clone() if x.is_inference() else x for name, x in tensors.items()}
        return cls(**vars(file.from_tensors(plain, metadata)))

    def byte_counts(self) -> dict[str, int]:
        """Stored bytes of weights, dictionary and residual, and of the whole file."""
        return {**file.byte_counts(self.to_tensors()[0]), "total": len(self.pack())}

    def bytes_per_texel(self) -> float:
        """Bytes of the file that each texel takes, without the basis that all texels share."""
        tensors, metadata = self.to_tensors()
        return (
            len(tensor_file.pack(tensors, metadata)) - file.shared_bytes(tensors)
        ) / self.texel_count

    @property
    def dictionary(self) -> LobeBatch:
        """The J lobes."""
        parts = (self.lobe_model, self.kappa, self.normal, self.angle)
        return LobeBatch(*parts, self.horizon, self.lowest_light)

    @property
    def cluster_count(self) -> int:
        """Number of clusters, K."""
        return len(self.residual.code) or int(self.labels.max()) + 1

    @property
    def texel_count(self) -> int:
        """Number of texels, T."""
        return self.height * self.width

    @property
    def sparse_weights(self) -> SparseWeights:
        """The entries of all texels."""
        return SparseWeights(self.offset, self.index, self.weight)

    @torch.no_grad()
    def narrow_share(self, width: float) -> float:
        """The share of the lobes' mean reflection that lobes narrower than `width` have.

        Args:
            width: in radians; see `Parameter.from_width`.
        """
        lobes = self.dictionary.detach()
        mean = lobe_intensity(lobes, LobeTable.build(lobes))[self.index] * self.weight.mean(1)
        narrow = specular_mask(lobes, width)[self.index]
        return float(mean[narrow].sum()) / max(float(mean.sum()), torch.finfo(mean.dtype).tiny)

    def lobe_count_per_texel(self) -> Tensor:
        """Number of lobes of each texel, `[T]`."""
        return self.offset[1:] - self.offset[:-1]

    def lobe_use_by_model(self) -> dict[str, int]:
        """Number of (texel, lobe) entries of each BRDF in use, the most used first."""
        uses = torch.bincount(self.lobe_model[self.index], minlength=len(MODEL_NAMES)).tolist()
        ordered = sorted(zip(MODEL_NAMES, uses, strict=True), key=lambda use: -use[1])
        return {name: count for name, count in ordered if count}

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        """Moves and makes anew what is kept beside parameters and buffers."""
        super()._apply(fn, recurse)
        self._keep_structure()
        return self

    def _keep_structure(self, *_: object) -> None:
        """Keeps the entries' tensors apart from the buffers: an export has these replaced."""
        self._structure = self.offset, self.index, self.lobe_model
        self.steepest = steepest(self.view, STEEPEST)
        self.lowest_view = lowest_cosine(self.view)
