"""Tables of a model as rays read them, made of its parameters so that gradients pass through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..brdf import MODEL_NAMES
from ..errors import DataError
from ..model.components import Components
from ..model.lookup import SparseWeights, TexelBlocks
from ..model.sampling import CODE_MAX, SamplingData
from ..model.spmm import SPMM
from .arrays import float_array, index_array, joined, power_of_two, taken
from .brdf import TWINS, Twin
from .libraries import dr
from .lobe import KAPPA, LOBE
from .mixture import CHANNELS, Entries
from .residual import BYTES, TOP_STEP, WIDTH, WORDS

# What `Rows.place` has where a row holds no number.
NONE = -1


@dataclass(frozen=True)
class Rows:
    """Where the numbers of a table stand among those of a parameter.

    Attributes:
        place: of each number, `[n]`, of the variant.
        counts: 0 where there is none, `[n]`.
    """

    place: Any
    counts: Any

    @classmethod
    def build(cls, place: Tensor) -> Rows:
        """The rows of places `[...]`, NONE for none."""
        return cls(index_array(place.clamp(min=0)), index_array(place != NONE))

    def of(self, parameter: Any) -> Any:
        """The table, flat, of a parameter."""
        return taken(parameter.array, self.place, self.counts)


def blocks(corners: Tensor, offset: Tensor, index: Tensor, codes: Tensor) -> TexelBlocks:
    """The lobes of each block of texels, each once.

    Args:
        corners: texels of each block, `[T, n]`.
        offset, index, codes: entries of all texels, `[T + 1]`, `[n]` and `[n]`.
    """
    wanted = torch.ones_like(corners, dtype=torch.bool)
    weights = SparseWeights(offset.long(), index.long(), codes[:, None].double())
    return TexelBlocks.build(corners, wanted, weights)  # float64 is exact up to 2^53


@dataclass(frozen=True)
class Merged:
    """The lobes of each block of texels, each once.

    Attributes:
        lobe, block, kind: of each entry, `[M]`; kind is a place among `models_in_use`.
        place: where its weights stand among those of the parameter, `[M, CHANNELS, n]`.
    """

    lobe: Tensor
    block: Tensor
    kind: Tensor
    place: Tensor

    @classmethod
    def build(cls, corners: Tensor, model: SPMM) -> Merged:
        """The entries of a model; `corners` are the texels of each block, `[T, n]`."""
        entries, channels = model.weight.shape
        merged = blocks(corners, model.offset, model.index, torch.arange(1, entries + 1))
        entry = merged.weight[:, None, :, 0].long() - 1  # [M, 1, n]
        place = torch.where(entry >= 0, entry * channels + _channel(channels)[:, None], NONE)
        place = torch.nn.functional.pad(place, (0, 0, 0, CHANNELS - 3), value=NONE)
        block = torch.repeat_interleave(merged.count)
        return cls(merged.lobe, block, kind_of_lobes(model)[merged.lobe], place)

    def codes(self, specular: TexelBlocks) -> Tensor:
        """The codes of entries in their texels, `[M, n]` long; 0 where they are not sampled."""
        lobes = 1 + int(self.lobe.max()) if len(self.lobe) else 1
        key, order = torch.sort(self.block * lobes + self.lobe)  # each stands once
        sampled = torch.repeat_interleave(specular.count) * lobes + specular.lobe
        codes = torch.zeros(len(key), specular.texel.shape[1], dtype=torch.long)
        codes[order[torch.searchsorted(key, sampled)]] = specular.weight[..., 0].long()
        return codes


def all_entries(merged: Merged, specular: TexelBlocks, kinds: int) -> tuple[Entries, Rows]:
    """(the entries of all blocks by BRDF, those that are sampled apart; where their weights stand).

    Args:
        merged: the entries.
        specular: those that are sampled.
        kinds: models in use.
    """
    codes = merged.codes(specular)
    groups = 2 * kinds
    group = 2 * merged.kind + codes.any(dim=1)
    order = torch.argsort(merged.block * groups + group, stable=True)
    size = torch.bincount(merged.block * groups + group, minlength=specular.count.numel() * groups)
    entries = _entries(size.view(-1, groups), merged.lobe[order], codes[order])
    return entries, Rows.build(merged.place[order])


def specular_blocks(corners: Tensor, data: SamplingData) -> TexelBlocks:
    """The entries of each block that are sampled, with their codes as weights.

    Args:
        corners: texels of each block, `[T, n]`.
        data: of the model.
    """
    return blocks(corners, data.offset, data.index, data.gamma)


def specular_entries(specular: TexelBlocks) -> Entries:
    """The entries that are sampled, alone."""
    codes = specular.weight[..., 0].long()
    return _entries(specular.count[:, None], specular.lobe, codes)


def group_codes(corners: Tensor, data: SamplingData) -> Any:
    """Codes of the specular groups of the texels `[T, n]` of each block, a byte each of a word."""
    return index_array(_word(data.group[corners].long()))


def lobe_table(model: SPMM, parameters: dict[str, Any]) -> Any:
    """`Lobes.table` of the parameters `kappa`, `normal` and `angle`."""
    lobes, columns = model.kappa.shape
    each = torch.arange(lobes)
    normal = [Rows.build(3 * each + n).of(parameters["normal"]) for n in range(3)]
    kappa = [Rows.build(columns * each + n).of(parameters["kappa"]) for n in range(columns)]
    zero = float_array(torch.zeros(lobes))
    turn = dr.sincos(parameters["angle"].array)
    table = [*turn, *normal, *kappa, *(zero for _ in range(LOBE - KAPPA - columns))]
    by_lobe = torch.arange(LOBE) * lobes + each[:, None]  # [J, LOBE]
    return dr.gather(type(zero), joined(table), index_array(by_lobe))


def kind_of_lobes(model: SPMM) -> Tensor:
    """The place of each lobe's BRDF among `models_in_use`, `[J]`."""
    return torch.searchsorted(models_in_use(model), model.lobe_model)


def models_in_use(model: SPMM) -> Tensor:
    """Models `[n]` that lobes have, ascending."""
    return torch.unique(model.lobe_model)


def twins_in_use(model: SPMM) -> tuple[Twin, ...]:
    """The twins of the models that lobes have.

    Raises:
        DataError: a model has none.
    """
    names = [MODEL_NAMES[number] for number in models_in_use(model).tolist()]
    for name in names:
        if name not in TWINS:
            raise DataError(
                f"{model.name!r} has lobes of {name}, which the plug-in for Mitsuba lacks; "
                f"expected some of {', '.join(TWINS)}; add it to spmm_torch/mitsuba/brdf."
            )
    return tuple(TWINS[name] for name in names)


def cluster_rows(model: SPMM) -> Rows:
    """Where the values `[K * D, 4]` of the residual of clusters stand."""
    code = model.residual.code
    channels = code.shape[-1]
    column = torch.cat((_channel(channels), torch.tensor([NONE])))
    place = torch.arange(code[..., 0].numel())[:, None] * channels + column
    return Rows.build(torch.where(column == NONE, NONE, place))


def width_of(components: Components) -> int:
    """Components that are read at once: the next power of two, at most WIDTH."""
    return min(WIDTH, max(4, power_of_two(components.rank)))


def padded_rank(components: Components) -> int:
    """Components of a row of a table: the next multiple of `width_of`."""
    width = width_of(components)
    return -(-components.rank // width) * width


def function_rows(components: Components) -> Rows:
    """Where functions `[D, 3, R']` stand among those `[R, V, L, C]` of the parameter."""
    rank, channels = components.rank, components.code.shape[-1]
    component = torch.arange(padded_rank(components))
    pairs = components.code[0, ..., 0].numel()
    pair = torch.arange(pairs)[:, None, None]
    function = (component * pairs + pair) * channels + _channel(channels)[:, None]
    return Rows.build(torch.where(component < rank, function, NONE))


def coefficient_rows(components: Components, texels: int) -> Rows:
    """Where coefficients `[T, R']` stand among those `[T, R]` of the parameter."""
    component = torch.arange(padded_rank(components))
    coefficient = torch.arange(texels)[:, None] * components.rank + component
    return Rows.build(torch.where(component < components.rank, coefficient, NONE))


def byte_words(components: Components) -> tuple[Any, Any, int]:
    """(functions `[D, W]` of signed bytes, four a word; scales `[V, R']` over TOP_STEP; W)."""
    pad = (0, padded_rank(components) - components.rank)
    code = components.code[..., _channel(components.code.shape[-1])]  # [R, V, L, 3]
    rows = torch.nn.functional.pad(code.flatten(1, 2).permute(1, 2, 0), pad).flatten(1)
    rows = torch.nn.functional.pad(rows, (0, -rows.shape[1] % (BYTES * WORDS)))
    words = rows.cpu().numpy().astype("<i1").view("<u4")  # the first byte lowest
    scales = torch.nn.functional.pad(components.scale.T, pad) / TOP_STEP
    return index_array(words), float_array(scales), words.shape[1]


def _entries(size: Tensor, lobe: Tensor, codes: Tensor) -> Entries:
    """The entries of lobes `[M]` and codes `[M, n]`, by block and group of `size [T, G]`."""
    groups = size.any(dim=0).nonzero().flatten()
    last = size[:, groups].flatten().cumsum(0).view(len(size), len(groups))
    ends = torch.cat((last[:, :1] - size[:, groups[:1]], last), dim=1)
    ends = torch.nn.functional.pad(ends, (0, power_of_two(ends.shape[1]) - ends.shape[1]))
    links = torch.stack((lobe.long(), _word(codes)), dim=1)
    return Entries(index_array(ends), tuple(groups.tolist()), index_array(links))


def _word(codes: Tensor) -> Tensor:
    """Up to four bytes `[M, n]` as words `[M]`, the first one lowest."""
    shift = 8 * torch.arange(codes.shape[1])
    return (codes.clamp(max=CODE_MAX) << shift).sum(dim=1)


def _channel(channels: int) -> Tensor:
    """The channels `[3]` that red, green and blue are."""
    return torch.arange(3).clamp(max=channels - 1)
