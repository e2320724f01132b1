"""The sparse parametric mixture model as a torch module [WDR11 Eq. 2]."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor, nn

from ..brdf import MODEL_NAMES
from ..errors import ConfigError, OutputError
from ..geometry.directions import CLAMP, REPEAT, RULES, texel_at
from ..geometry.grazing import held_view, lowest_cosine
from ..geometry.relief import steepest, texel_centres
from ..lobes.batch import LobeBatch
from ..lobes.sampling import LobeTable, lobe_intensity, specular_mask
from ..runtime import tensor_file
from ..runtime.atomic import write_atomic
from ..runtime.device import full_precision, plain_torch
from . import bounds, dense, file, ragged, sampling
from .components import Components, changes
from .lookup import MergedEntries, SparseWeights, all_blocks
from .queries import check_queries
from .relief import STEEPEST, Relief
from .residual import Residual


class SPMM(nn.Module):
    """T = H x W texels, each a short non-negative sum of J shared lobes, plus a residual.

    s_x(wi, wo) = sum_j alpha_j rho_j(wi, wo) + epsilon_k(wi, wo) [WDR11 Eq. 2]. alpha, kappa,
    normals, angles and epsilon are parameters of the module; epsilon starts without gradient. With
    components, sum_r c_r B_r(wi, wo) is added to epsilon, or is all of it.

    Queries are checked: directions that are not unit, or NaN, are refused. This costs about a
    hundredth of an evaluation on a CPU, and one wait for a GPU; `checks_queries = False` turns it
    off.

    `wrap` says how uv go on beyond the border in place of the rule of the relief: `repeat`,
    `mirror`, or `clamp`, which holds them at the centres of the border's texels. It is a setting of
    the lookup, and no part of a file.

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
    checks_queries: bool = True

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
        self._wrap: str | None = None
        self._sampling: tuple[tuple[object, ...], sampling.SamplingData] | None = None
        self._dense: tuple[tuple[object, ...], dense.DenseTables] | None = None
        self._whole: tuple[tuple[object, ...], MergedEntries] | None = None
        self.kept_blocks: ragged.KeptBlocks | None = None
        self._keep_structure()
        self.register_load_state_dict_post_hook(SPMM._keep_structure)

    @classmethod
    def load(cls, run: Path | str, device: torch.device | str = "cpu") -> SPMM:
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
        target = Path(path)
        write_atomic(target / tensor_file.MODEL_FILE if target.is_dir() else target, self.pack())

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

    def project_(self) -> SPMM:
        """Takes the parameters to the nearest valid ones, in place; returns the model.

        Weights are not below 0, normals are unit and within 85 degrees of z, kappa is in the range
        of its BRDF. For the end of each step of training, which knows nothing of these bounds.
        """
        bounds.project(self)
        return self

    def requires_grad_lobes(self, requires_grad: bool = True) -> SPMM:
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
    def from_tensors(cls, tensors: dict[str, Tensor], metadata: dict[str, str]) -> SPMM:
        """The model of tensors and metadata; see `SPMM.to_tensors`.

        Raises:
            KeyError: a tensor or a key of the metadata is missing.
            ValueError: a BRDF is not known, or a height or width is not a number.
        """
        return cls(**vars(file.from_tensors(tensors, metadata)))

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
    def rule(self) -> str:
        """How the texture continues beyond its border; see `directions.RULES`."""
        if self.wrap in RULES:
            return self.wrap
        return REPEAT if self.relief is None else self.relief.rule

    @property
    def wrap(self) -> str | None:
        """How uv go on beyond the border: `repeat`, `mirror`, `clamp`; None: by the relief's rule.

        Raises:
            ConfigError: another word is set.
        """
        return self._wrap

    @wrap.setter
    def wrap(self, wrap: str | None) -> None:
        """Sets how uv go on."""
        if wrap not in (None, CLAMP, *RULES):
            raise ConfigError(
                f"wrap is {wrap!r}; expected one of {', '.join((*RULES, CLAMP))}, or None for the "
                f"rule of the relief; choose one of them."
            )
        self._wrap = wrap

    def held(self, uv: Tensor) -> Tensor:
        """uv `[..., 2]` as looked up: with `clamp`, between the outer centres of texels."""
        if self.wrap != CLAMP:
            return uv
        half = 0.5 / self.width, 0.5 / self.height
        parts = zip(uv.unbind(-1), half, strict=True)
        return torch.stack([part.clamp(edge, 1.0 - edge) for part, edge in parts], dim=-1)

    @property
    def sparse_weights(self) -> SparseWeights:
        """The entries of all texels."""
        return SparseWeights(self.offset, self.index, self.weight)

    def forward(
        self,
        uv: Tensor,
        wi: Tensor,
        wo: Tensor,
        residual: bool = True,
        padded: bool | None = None,
    ) -> Tensor:
        """Cosine-weighted reflectance [WDR11 Eq. 2].

        A view shows the point where its ray meets the relief. Texels are interpolated bilinearly,
        and the texture repeats, or continues by the rule of its relief; without a relief, a texel
        centre returns its texel. Lobes are analytic, so directions need not be measured ones; the
        residual is interpolated between those, and signed, so values a little below 0 occur. Both
        fade below the lowest measured light. A relief shows to views below the lowest measured one
        what it shows to that.

        There are two ways to the same values: ragged lists, which is the fast way of a program that
        runs as it stands, and padded tables, which `torch.compile`, `torch.export` and `torch.func`
        can follow. These get the second, unless told otherwise, and check no queries.

        Args:
            uv: texture coordinates `[..., 2]`, u right, v up.
            wi, wo: unit light and view directions `[..., 3]`, pointing away from the surface.
            residual: whether to add epsilon.
            padded: whether to go by padded tables; None: where torch records or transforms.

        Returns:
            Linear RGB `[..., C]`; 0 where wi or wo is under the horizon. Differentiable.

        Raises:
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`.
        """
        traced = dense.traced()
        if self.checks_queries and not traced:
            check_queries(uv=uv, wi=wi, wo=wo)
        shape = torch.broadcast_shapes(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        uv, wi, wo = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        wo = self.held_view(wo)
        if traced if padded is None else padded:
            value = dense.values(
                self, uv, wi, wo, residual=residual, block=ragged.EVALUATED_ENTRIES
            )
        else:
            value = self._ragged(uv, wi, wo, residual)
        return value.view(*shape, self.weight.shape[1])

    def held_view(self, wo: Tensor) -> Tensor:
        """Views `[..., 3]` as they are shown: of a relief none is below all measured ones."""
        if self.relief is None:
            return wo
        uneven = self.relief.height.detach().any()  # no height at all is no relief
        return torch.where(uneven, held_view(wo, self.lowest_view), wo)

    @full_precision()
    def _ragged(self, uv: Tensor, wi: Tensor, wo: Tensor, residual: bool) -> Tensor:
        """`forward` of queries `[Q, 2]` and `[Q, 3]` by ragged lists, `[Q, C]`."""
        return ragged.values(self, *self.texels_seen(uv, wo), wi, wo, residual=residual)

    def padded_tables(self) -> dense.DenseTables:
        """The entries of all texels with padding, kept as long as they are the same.

        What was compiled or exported holds those of its time.
        """
        self._keep_tables()
        assert self._dense is not None
        return self._dense[1]

    @dense.taken_as_constant
    def _keep_tables(self) -> None:
        """Makes `padded_tables` if there are none yet, or the entries are others; never traced."""
        state = tuple((part.data_ptr(), changes(part)) for part in self._structure)
        if self._dense is None or self._dense[0] != state:
            with dense.untraced():
                self._dense = state, dense.DenseTables.build(*self._structure)

    def merged_entries(self) -> MergedEntries:
        """The lobes of each 2 x 2 texels, by the first of them, kept as `padded_tables` are."""
        self._keep_merged()
        assert self._whole is not None
        return self._whole[1]

    @dense.taken_as_constant
    def _keep_merged(self) -> None:
        """Makes `merged_entries` as `_keep_tables` makes tables."""
        offset, index, _ = self._structure
        state = (self.rule, *((part.data_ptr(), changes(part)) for part in (offset, index)))
        if self._whole is None or self._whole[0] != state:
            with dense.untraced():
                texel = all_blocks(self.height, self.width, self.rule, offset.device)
                self._whole = state, MergedEntries.build(texel, None, offset, index)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> SPMM:
        """Moves and makes anew what is kept beside parameters and buffers."""
        super()._apply(fn, recurse)
        self._keep_structure()
        self.kept_blocks = None
        return self

    def _keep_structure(self, *_: object) -> None:
        """Keeps the entries' tensors apart from the buffers: an export has these replaced."""
        self._structure = self.offset, self.index, self.lobe_model
        self.steepest = steepest(self.view, STEEPEST)
        self.lowest_view = lowest_cosine(self.view)

    @full_precision()
    def sample(self, uv: Tensor, wo: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Light directions drawn by importance [WDR11 §6].

        Args:
            uv: texture coordinates `[..., 2]`.
            wo: unit view directions `[..., 3]`.
            u: uniform numbers `[..., 3]` in [0, 1).

        Returns:
            (wi `[..., 3]`, rgb = model(uv, wi, wo) `[..., C]`, pdf in 1/sr `[...]`).

        Raises:
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`.
        """
        if self.checks_queries:
            check_queries(uv=uv, wo=wo, u=u)
        shape = torch.broadcast_shapes(uv.shape[:-1], wo.shape[:-1], u.shape[:-1])
        uv, wo, u = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wo, 3), (u, 3)))
        wo = self.held_view(wo)
        texel, bilinear = self.texels_seen(uv, wo)
        with torch.no_grad():
            wi, density = sampling.sample(self.sampling_data(), texel, bilinear.detach(), wo, u)
        rgb = ragged.values(self, texel, bilinear, wi, wo, residual=True)
        return wi.view(*shape, 3), rgb.view(*shape, rgb.shape[1]), density.view(shape)

    @full_precision()
    @torch.no_grad()
    def pdf(self, uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density `[...]` of `sample` at wi, in 1/sr; above 0 over the horizon.

        Args:
            uv: texture coordinates `[..., 2]`.
            wi, wo: unit light and view directions `[..., 3]`.

        Raises:
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`.
        """
        if self.checks_queries:
            check_queries(uv=uv, wi=wi, wo=wo)
        shape = torch.broadcast_shapes(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        uv, wi, wo = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        wo = self.held_view(wo)
        texel, bilinear = self.texels_seen(uv, wo)
        return sampling.pdf(self.sampling_data(), texel, bilinear, wi, wo).view(shape)

    @plain_torch()
    @torch.no_grad()
    def sampling_data(self, renew: bool = False) -> sampling.SamplingData:
        """What importance sampling needs, kept until a parameter changes.

        A change through `.data`, which torch does not count, is not seen.

        Args:
            renew: whether to make it anew, whatever has been seen.
        """
        parts = (*self.parameters(), *self.buffers())
        state = tuple((part.data_ptr(), changes(part)) for part in parts)
        if renew or self._sampling is None or self._sampling[0] != state:
            data = sampling.SamplingData.build(
                self.dictionary, self.offset, self.index, self.weight, self._residual_intensity()
            )
            self._sampling = state, data
        return self._sampling[1]

    def texels_seen(self, uv: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
        """What views show at places of the plane: four texels each, and their bilinear weights.

        Everything that reads texels asks here.

        Args:
            uv: texture coordinates `[..., 2]`.
            wo: unit view directions `[..., 3]`.

        Returns:
            (index `[..., 4]`, weight `[..., 4]`).
        """
        uv = self.held(uv)
        if self.relief is None:
            return texel_at(uv, self.height, self.width, self.rule)
        field = self.relief.field(self.height, self.width, self.view, self.rule)
        return texel_at(field.hit(uv, wo), self.height, self.width, self.rule)

    def epsilon(self, texel: Tensor, weight: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Weighted sums `[Q, C]` of the whole residual of texels `[Q, M]`, without lobes.

        Args:
            texel: `[Q, M]`.
            weight: of each of them, `[Q, M]`.
            wi, wo: directions `[Q, 3]`.
        """
        near = self.residual.pairs.around(wi, wo)
        total = self.residual.at_pairs(self.labels[texel], weight, *near)
        if self.components is not None:
            total = total + self.components.at_pairs(texel, weight, *near)
        return total

    def _residual_intensity(self) -> Tensor:
        """What importance sampling takes for the size of the whole residual, `[T]` in 1/sr.

        Sizes of both kinds of residual are added, which is never too little.
        """
        total = torch.zeros_like(self.labels, dtype=self.residual.scale.dtype)
        if len(self.residual.code):
            size = sampling.residual_intensity(self.residual.code, self.residual.scale)  # [K]
            total = size[self.labels]
        return total if self.components is None else total + self.components.intensity()

    @full_precision()
    def picture(
        self, wi: Tensor, wo: Tensor, residual: bool = True, registered: bool = False
    ) -> Tensor:
        """Values `[H, W, C]` at all texel centres under one wi `[3]` and wo `[3]`, row 0 on top.

        Args:
            wi, wo: unit vectors.
            residual: whether to add the residual.
            registered: whether it lies as the measured picture of that view does, whose drift
                `relief` knows: for comparisons with measured pictures.

        Raises:
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`.
        """
        if self.checks_queries:
            check_queries(wi=wi, wo=wo)
        measured, wo = wo, self.held_view(wo)
        rho = self.dictionary.eval(wi[None, None], wo[None, None]).squeeze(1)  # [J]
        value = self.weight * rho[self.index, None]  # [N, C]
        texel = torch.repeat_interleave(self.lobe_count_per_texel())
        total = value.new_zeros(self.texel_count, value.shape[1]).index_add(0, texel, value)
        if residual:
            total = total + self._residual_picture(wi, wo)
        if self.relief is not None:
            centres = texel_centres(self.height, self.width, wo)
            if registered:
                centres = centres + self.relief.drift_of(measured[None], self.view)
            texel, bilinear = self.texels_seen(centres, wo)
            total = (total[texel] * bilinear[..., None]).sum(dim=1)
        return total.view(self.height, self.width, -1)

    def _residual_picture(self, wi: Tensor, wo: Tensor) -> Tensor:
        """The residual of all texels `[T, C]` under one wi `[3]` and wo `[3]`."""
        cluster = torch.arange(self.cluster_count, device=wi.device)
        pair = (len(cluster), 3)
        total = self.residual(cluster, wi.expand(pair), wo.expand(pair))[self.labels]
        if self.components is not None:
            functions = self.components.functions(wi[None], wo[None])[0]  # [R, C]
            total = total + self.components.coefficients().to(functions) @ functions
        return total

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
