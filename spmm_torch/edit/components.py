"""Components under edits: what is linear in colours acts on functions, what is masked on c.

A mask multiplies coefficients. Where it is hard they stay signed bytes and edited texels are exact;
where it is soft they become half floats, which hold every byte as it is. Texels of share 0 keep
their value to the bit in both cases.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..model.components import BYTE_MAX, Components, decode_functions, encode_functions

# Largest code of a half float after an edit: far enough from infinity for the next one.
HALF_LIMIT = 2.0**14


def scaled_components(components: Components, factor: float, share: Tensor | None) -> Components:
    """Components times `factor`, or times 1 + share (factor - 1), by shares of texels `[T]`."""
    if share is None:
        return components.with_codes(coefficient_scale=components.coefficient_scale * factor)
    gain = torch.lerp(torch.ones_like(share), share.new_tensor(factor), share)
    coefficient, scale = _coded(components, _times(components, gain))
    return components.with_codes(coefficient=coefficient, coefficient_scale=scale)


def mapped_components(components: Components, matrix: Tensor, share: Tensor | None) -> Components:
    """Components with colours times `matrix [C, C]`, by the share of each texel `[T]`.

    Under a mask there are twice as many: those of before for the share that is not edited, and
    those of mapped colours.
    """
    values = decode_functions(components.code.detach(), components.scale)
    code, scale = encode_functions(values @ matrix.to(values).T, components.code.dtype)
    mapped = components.with_codes(code, scale)
    return mapped if share is None else mixed((components, mapped), (1.0 - share, share))


def mixed(parts: tuple[Components, Components], shares: tuple[Tensor, Tensor]) -> Components:
    """The sum of two components, each by a share of each texel `[T]`.

    Equal functions are kept once. Others stand side by side; those that no texel has are left out.
    """
    first, second = parts
    if _share_functions(first, second):
        return _added(first, second, shares)
    coded = [_coded(part, _times(part, share)) for part, share in zip(parts, shares, strict=True)]
    coefficient = _joined([code for code, _ in coded], dim=1)
    used = (coefficient != 0).any(0)
    used[0] |= ~used.any()
    return first.with_codes(
        _joined([part.code.detach() for part in parts])[used],
        torch.cat([part.scale for part in parts])[used],
        coefficient[:, used],
        torch.cat([scale for _, scale in coded])[used],
    )


def _share_functions(first: Components, second: Components) -> bool:
    """Whether two components have the functions of one storage."""
    pairs = ((first.code, second.code), (first.scale, second.scale))
    return all(a.data_ptr() == b.data_ptr() and a.shape == b.shape for a, b in pairs)


def _added(first: Components, second: Components, shares: tuple[Tensor, Tensor]) -> Components:
    """`mixed` of components of equal functions."""
    scale = torch.maximum(first.coefficient_scale, second.coefficient_scale)
    divisor = torch.where(scale > 0.0, scale, 1.0)
    codes = [
        _times(part, share) * (part.coefficient_scale / divisor)
        for part, share in zip((first, second), shares, strict=True)
    ]
    coefficient, scale = _coded(first.with_codes(coefficient_scale=scale), codes[0] + codes[1])
    return first.with_codes(coefficient=coefficient, coefficient_scale=scale)


def _times(components: Components, share: Tensor) -> Tensor:
    """Codes of coefficients times a share of each texel `[T]`: `[T, R]`, not rounded."""
    return components.coefficient.detach().to(share) * share[:, None]


def _coded(components: Components, code: Tensor) -> tuple[Tensor, Tensor]:
    """(coefficient `[T, R]`, scale `[R]`) of codes `[T, R]` that may be fractions or large.

    Bytes where all of them are bytes, half floats elsewhere; scales grow by powers of two, which
    round nothing. Coefficients in float32 stay so.
    """
    scale, kind = components.coefficient_scale, components.coefficient.dtype
    if kind == torch.float32:
        return code.float(), scale
    if bool((code == code.round()).all()) and bool((code.abs() <= BYTE_MAX).all()):
        return code.to(torch.int8), scale
    largest = code.abs().amax(0).clamp(min=HALF_LIMIT)
    growth = torch.exp2(torch.ceil(torch.log2(largest / HALF_LIMIT)))
    return (code / growth).half(), scale * growth.to(scale)


def _joined(parts: list[Tensor], dim: int = 0) -> Tensor:
    """Codes one after the other, in the first type that holds all of them."""
    kinds = (torch.float32, torch.float16, torch.int8)
    kind = next(kind for kind in kinds if any(part.dtype == kind for part in parts))
    return torch.cat([part.to(kind) for part in parts], dim)
