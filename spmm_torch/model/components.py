"""A residual of rank R: few functions that all texels share, and a number a texel for each."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import embedding_bag

from ..geometry.shapes import broadcast_shape
from .changes import changes
from .measured_pairs import MeasuredPairs
from .residual import encode_residual

BYTE_MAX = 127  # largest signed byte that has a counterpart of the other sign


class Components(nn.Module):
    """epsilon_x = sum_r c_xr B_r, with R functions B_r on V x L measured pairs.

    Values of both are stored as `code * scale`. Signed bytes are enough for the functions too, with
    a scale for each component and view: highlights near grazing views would else take the range of
    all others. Half floats hold coefficients that an edit has made finer than bytes.

    Args:
        code: of the functions, `[R, V, L, C]` int8, float16 or float32.
        scale: of the functions, `[R, V]` float32, or `[R]` where all views share one.
        coefficient: codes of c, `[T, R]` int8, float16 or float32.
        coefficient_scale: `[R]` float32.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
    """

    scale: Tensor
    coefficient_scale: Tensor

    def __init__(
        self,
        code: Tensor,
        scale: Tensor,
        coefficient: Tensor,
        coefficient_scale: Tensor,
        light: Tensor,
        view: Tensor,
    ) -> None:
        super().__init__()
        self.code = nn.Parameter(code, requires_grad=False)
        self.coefficient = nn.Parameter(coefficient, requires_grad=False)
        by_view = scale[:, None] if scale.dim() == 1 else scale
        self.register_buffer("scale", by_view.expand(code.shape[:2]).contiguous())
        self.register_buffer("coefficient_scale", coefficient_scale)
        self.pairs = MeasuredPairs.build(light, view)
        self._kept: tuple[tuple[Any, ...], tuple[Tensor, Tensor]] | None = None

    @property
    def rank(self) -> int:
        """Number of components, R."""
        return len(self.code)

    def with_codes(
        self,
        code: Tensor | None = None,
        scale: Tensor | None = None,
        coefficient: Tensor | None = None,
        coefficient_scale: Tensor | None = None,
    ) -> Components:
        """The same directions with other functions or coefficients; what is not given is shared.

        Args:
            code: `[R', V, L, C]`.
            scale: `[R', V]`.
            coefficient: `[T, R']`.
            coefficient_scale: `[R']`.
        """
        return Components(
            self.code.detach() if code is None else code,
            self.scale if scale is None else scale,
            self.coefficient.detach() if coefficient is None else coefficient,
            self.coefficient_scale if coefficient_scale is None else coefficient_scale,
            self.pairs.light.directions,
            self.pairs.view.directions,
        )

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Components:
        """Moves the meshes with the module, without a change of their dtype."""
        super()._apply(fn, recurse)
        self.pairs = self.pairs.to(self.code.device)
        self._kept = None
        return self

    def forward(self, texel: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """The residual `[..., C]` of texels `[...]` at wi and wo `[..., 3]`, piecewise linear.

        It fades and ends as that of clusters does; see `Residual.forward`.
        """
        shape = broadcast_shape(texel.shape, wi.shape[:-1], wo.shape[:-1])
        wi, wo = (x.expand(*shape, 3).reshape(-1, 3) for x in (wi, wo))
        texel = texel.expand(shape).reshape(-1, 1)
        value = self.blend(texel, torch.ones_like(texel, dtype=wi.dtype), wi, wo)
        return value.view(*shape, -1)

    def blend(self, texel: Tensor, weight: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Weighted sums `[Q, C]` of the residuals of texels `[Q, M]`; see `forward`.

        Args:
            texel: `[Q, M]`.
            weight: of each of them, `[Q, M]`.
            wi, wo: directions `[Q, 3]`.
        """
        return self.at_pairs(texel, weight, *self.pairs.around(wi, wo))

    def at_pairs(self, texel: Tensor, weight: Tensor, pair: Tensor, pair_weight: Tensor) -> Tensor:
        """`blend` given the pairs around each query and their weights, both `[Q, 9]`."""
        return blended(*self._tables(pair_weight.dtype), texel, weight, pair, pair_weight)

    def functions(self, wi: Tensor, wo: Tensor) -> Tensor:
        """The functions B at Q queries, `[Q, R, C]`.

        Args:
            wi, wo: directions `[Q, 3]`.
        """
        pair, weight = self.pairs.around(wi, wo)
        table, _ = self._tables(weight.dtype)
        value = embedding_bag(pair, table, mode="sum", per_sample_weights=weight)
        return value.unflatten(1, (self.rank, -1))

    def measured(self, texel: Tensor, pair: Tensor) -> Tensor:
        """The residual `[Q, C]` of texels `[Q]` at measured pairs `[Q]`, view * L + light."""
        functions, coefficients = self._tables(self.scale.dtype)
        value = functions.index_select(0, pair).unflatten(1, (self.rank, -1))
        return torch.bmm(coefficients.index_select(0, texel)[:, None], value).squeeze(1)

    def coefficients(self) -> Tensor:
        """The coefficients c, `[T, R]` float32."""
        return decode_coefficients(self.coefficient, self.coefficient_scale)

    @torch.no_grad()
    def intensity(self) -> Tensor:
        """Root mean square of epsilon_x over measured pairs and channels, `[T]` in 1/sr.

        By the Gram matrix of the functions: c^T G c. It is never below the mean size of the
        residual, and needs no pass over texels and pairs.
        """
        functions, coefficients = self._tables(self.scale.dtype)
        rows = functions.unflatten(1, (self.rank, -1)).transpose(1, 2).flatten(0, 1)  # [V L C, R]
        gram = rows.T @ rows / len(rows)
        return ((coefficients @ gram) * coefficients).sum(1).clamp(min=0.0).sqrt()

    def _tables(self, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        """Functions `[V L, R C]`, pair by pair, and coefficients `[T, R]`, as numbers of a type.

        They are kept until what they are made of changes, and made anew where it has gradients.
        """
        parts = (self.code, self.scale, self.coefficient, self.coefficient_scale)
        if any(part.requires_grad for part in parts):
            return self.decoded(dtype)
        state = (dtype, *((part.data_ptr(), changes(part)) for part in parts))
        if self._kept is None or self._kept[0] != state:
            self._kept = state, self.decoded(dtype)
        return self._kept[1]

    def decoded(self, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        """Functions `[V L, R C]`, pair by pair, and coefficients `[T, R]`, made anew."""
        functions = self.code.to(dtype) * self.scale.to(dtype)[:, :, None, None]
        coefficients = self.coefficient.to(dtype) * self.coefficient_scale.to(dtype)
        return functions.permute(1, 2, 0, 3).flatten(2).flatten(0, 1), coefficients


def blended(
    functions: Tensor,
    coefficients: Tensor,
    texel: Tensor,
    weight: Tensor,
    pair: Tensor,
    pair_weight: Tensor,
) -> Tensor:
    """Weighted sums `[Q, C]` of the residuals of texels, between measured pairs.

    The functions are interpolated once and the coefficients of the texels mixed before they meet,
    so M texels cost hardly more than one.

    Args:
        functions, coefficients: `[V L, R C]` and `[T, R]`, of one type.
        texel, weight: texels of each query and their weights, `[Q, M]`.
        pair, pair_weight: pairs around each query and their weights, `[Q, 9]`.
    """
    weight, pair_weight = weight.to(functions.dtype), pair_weight.to(functions.dtype)
    mixed = embedding_bag(texel, coefficients, mode="sum", per_sample_weights=weight)  # [Q, R]
    value = embedding_bag(pair, functions, mode="sum", per_sample_weights=pair_weight)
    return torch.bmm(mixed[:, None], value.unflatten(1, (mixed.shape[1], -1))).squeeze(1)


def encode_functions(values: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Functions as codes of a type, and a scale for each component and view.

    Args:
        values: `[R, V, L, C]`.
        dtype: int8, float16 or float32.

    Returns:
        (code `[R, V, L, C]`, scale `[R, V]`), values ~ code * scale.
    """
    rows = values.flatten(0, 1)  # [R V, L, C]
    if dtype != torch.int8:
        code, scale = encode_residual(rows, dtype)
    else:
        code, scale = _encode_bytes(rows.flatten(1))
    return code.view(values.shape), scale.view(values.shape[:2])


def decode_functions(code: Tensor, scale: Tensor) -> Tensor:
    """Values `[R, V, L, C]` float32 of codes `[R, V, L, C]` and scales `[R, V]`."""
    return code.float() * scale[:, :, None, None]


def encode_coefficients(values: Tensor, dtype: torch.dtype = torch.int8) -> tuple[Tensor, Tensor]:
    """Coefficients as codes of a type, and a scale for each component.

    Args:
        values: `[T, R]`.
        dtype: int8 or float16.

    Returns:
        (code `[T, R]`, scale `[R]`), values ~ code * scale.
    """
    encode = _encode_bytes if dtype == torch.int8 else partial(encode_residual, dtype=dtype)
    code, scale = encode(values.T)
    return code.T.contiguous(), scale


def decode_coefficients(code: Tensor, scale: Tensor) -> Tensor:
    """Values `[T, R]` float32 of codes `[T, R]` and scales `[R]`."""
    return code.float() * scale


def _encode_bytes(values: Tensor) -> tuple[Tensor, Tensor]:
    """(code `[N, P]` int8, scale `[N]`) of rows `[N, P]`, whose largest size is BYTE_MAX."""
    largest = values.abs().amax(1).clamp(min=torch.finfo(torch.float32).tiny * BYTE_MAX)
    scale = largest.float() / BYTE_MAX
    code = torch.round(values / scale[:, None]).clamp(-BYTE_MAX, BYTE_MAX)
    return code.to(torch.int8), scale
