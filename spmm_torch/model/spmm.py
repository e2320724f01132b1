"""The sparse parametric mixture model as a torch module [WDR11 Eq. 2]."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import torch
from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import CLAMP, REPEAT, RULES, texel_at
from ..geometry.grazing import held_view
from ..geometry.relief import texel_centres
from ..geometry.shapes import broadcast_shape
from ..runtime.device import full_precision, plain_torch
from . import dense, ragged, sampling
from .changes import changes
from .lookup import MergedEntries, all_blocks
from .mixture import Mixture
from .queries import check_queries


class SPMM(Mixture):
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
    """

    checks_queries: bool = True
    kept_blocks: ragged.KeptBlocks | None = None
    _wrap: str | None = None
    _sampling: tuple[tuple[object, ...], sampling.SamplingData] | None = None
    _dense: tuple[tuple[object, ...], dense.DenseTables] | None = None
    _whole: tuple[tuple[object, ...], MergedEntries] | None = None

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
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
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

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        """Moves parameters and buffers, and forgets what was kept for the last queries."""
        super()._apply(fn, recurse)
        self.kept_blocks = None
        return self

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
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`. Or
                `torch.func` transforms it.
        """
        dense.refuse_transforms("sample")
        if self.checks_queries:
            check_queries(uv=uv, wo=wo, u=u)
        shape = broadcast_shape(uv.shape[:-1], wo.shape[:-1], u.shape[:-1])
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
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`. Or
                `torch.func` transforms it.
        """
        dense.refuse_transforms("pdf")
        if self.checks_queries:
            check_queries(uv=uv, wi=wi, wo=wo)
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
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

        Each lobe is evaluated once; where torch records or transforms, once a texel by `forward`.

        Args:
            wi, wo: unit vectors.
            residual: whether to add the residual.
            registered: whether it lies as the measured picture of that view does, whose drift
                `relief` knows: for comparisons with measured pictures.

        Raises:
            DataError: a direction is not unit, or a number is NaN; see `checks_queries`.
        """
        if dense.traced():
            centres = self._centres(wo, registered)
            return self(centres, wi, wo, residual).view(self.height, self.width, -1)
        if self.checks_queries:
            check_queries(wi=wi, wo=wo)
        centres, wo = self._centres(wo, registered), self.held_view(wo)
        rho = self.dictionary.eval(wi[None, None], wo[None, None]).squeeze(1)  # [J]
        value = self.weight * rho[self.index, None]  # [N, C]
        texel = torch.repeat_interleave(self.lobe_count_per_texel())
        total = value.new_zeros(self.texel_count, value.shape[1]).index_add(0, texel, value)
        if residual:
            total = total + self._residual_picture(wi, wo)
        if self.relief is not None:
            texel, bilinear = self.texels_seen(centres, wo)
            total = (total[texel] * bilinear[..., None]).sum(dim=1)
        return total.view(self.height, self.width, -1)

    def _centres(self, wo: Tensor, registered: bool) -> Tensor:
        """uv `[T, 2]` of what a picture from wo `[3]` shows, row 0 on top; see `picture`."""
        centres = texel_centres(self.height, self.width, wo)
        if self.relief is None or not registered:
            return centres
        return centres + self.relief.drift_of(wo[None], self.view)

    def _residual_picture(self, wi: Tensor, wo: Tensor) -> Tensor:
        """The residual of all texels `[T, C]` under one wi `[3]` and wo `[3]`."""
        cluster = torch.arange(self.cluster_count, device=wi.device)
        pair = (len(cluster), 3)
        total = self.residual(cluster, wi.expand(pair), wo.expand(pair))[self.labels]
        if self.components is not None:
            functions = self.components.functions(wi[None], wo[None])[0]  # [R, C]
            total = total + self.components.coefficients().to(functions) @ functions
        return total
