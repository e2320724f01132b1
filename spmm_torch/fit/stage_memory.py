"""The memory that each stage of a fit takes, from the size of its input and its settings."""

from __future__ import annotations

import torch

from ..config.fit import FitConfig, WeightsConfig
from ..data import BTF
from ..data.blocks import BLOCK_COPIES, CUDA_BLOCK_VALUES, block_texels
from ..lobes.batch import COORDINATES
from .glossy.objective import most_models
from .refit.normal import PRODUCT_BYTES
from .relief.estimate import LEAST_SIDE, LEAST_VIEWS
from .relief.pictures import MAX_VIEWS
from .relief.search import JUDGED, SOUGHT
from .search.bank import SHAPES
from .search.joint import BATCH_ROWS, CPU_JACOBIAN_VALUES
from .search.lobes import bank_normals
from .select.alternate import CPU_TEXELS, SELECT_BYTES
from .select.clusters import PILOTS

FLOAT = 4
# Modules that stages load, and what the heap keeps for later.
LATER = 32 << 20
# Copies of the samples, of the bank, of one Jacobian, of the lobes of each sample.
SAMPLE_COPIES, BANK_COPIES, JACOBIAN_COPIES, SLOT_COPIES = 6, 2, 8, 2
# Copies of the dictionary where errors have weights: weighted, plain, and at measured pairs only.
WEIGHTED_COPIES = 3
# Copies of the pictures in which a relief is sought.
STACK_COPIES = 3
# Bytes of what a pixel shows, four texels and weights, there and back; and of its squares.
LOOKUP_BYTES, SQUARE_BYTES = 64, 20
# Copies of the pictures of one view.
PICTURE_COPIES = 3
# Lobes of a texel where no limit is set, about; bytes of a place in the matrix of all weights.
TEXEL_LOBES, PLACE_BYTES = 6, 8
# Texels around one whose lobes show in the same pixels.
AROUND = 9


def working_bytes(
    btf: BTF, config: FitConfig, device: torch.device, samples: int, found: int
) -> int:
    """Bytes of the stage that needs most, decoded values and what is held before it apart.

    Args:
        btf: the input.
        config: of the fit.
        device: of the fit; on a GPU the host holds blocks, and what it looks pictures up by.
        samples: number of texels that are searched.
        found: number of lobes found in them.
    """
    if device.type == "cuda":
        return LATER + max(FLOAT * BLOCK_COPIES * CUDA_BLOCK_VALUES // 8, _relief(btf, config))
    block = FLOAT * BLOCK_COPIES * _block_values(btf, device)
    search = _search(btf, config, samples)
    atoms = FLOAT * btf.pair_count * found
    uniform = config.weights == WeightsConfig(error="l2", floor=config.weights.floor)
    copies = 1 if uniform and btf.missing is None else WEIGHTED_COPIES
    dictionary = (2 + copies) * atoms
    select = copies * atoms + block + SELECT_BYTES * _choices(btf, config, found)
    refit = _refit(btf, config, found)
    return LATER + max(block, _relief(btf, config), search, dictionary, select, refit)


def _block_values(btf: BTF, device: torch.device) -> int:
    """Values of the blocks in which all texels are passed over."""
    texels = min(btf.texel_count, block_texels(btf, device))
    return texels * btf.pair_count * btf.channels


def _choices(btf: BTF, config: FitConfig, found: int) -> int:
    """Texels times the lobes that they choose from, of one block of a cluster."""
    texels, pilot = min(CPU_TEXELS, btf.texel_count), config.select.pilot
    own = found // config.cluster.count
    if config.dictionary.scope == "cluster":
        return texels * own
    whole = texels if pilot is None else min(texels, PILOTS * pilot)
    return max(whole * found, texels * own)


def _search(btf: BTF, config: FitConfig, samples: int) -> int:
    """Samples, the bank, and the lobes of all samples or their Jacobian."""
    pairs, search = btf.pair_count, config.search
    normals = 1 + bank_normals(search, samples)
    models = search.models if config.weights.error == "l2" else most_models(search.models)
    bank = sum(len(SHAPES[name]) for name in models) * normals
    held = FLOAT * pairs * (SAMPLE_COPIES * samples * btf.channels + BANK_COPIES * bank)
    if search.method == "stagewise":
        return held + SLOT_COPIES * FLOAT * pairs * samples * search.max_lobes
    row = search.max_lobes * COORDINATES * pairs
    rows = samples * search.restarts if search.restarts else max(samples, BATCH_ROWS)
    return held + JACOBIAN_COPIES * FLOAT * max(row, min(CPU_JACOBIAN_VALUES, rows * row))


def _relief(btf: BTF, config: FitConfig) -> int:
    """The pictures in which a relief is sought."""
    if not _may_be_mixed(btf, config):
        return 0
    lights = min(len(btf.light), SOUGHT + JUDGED)
    pictures = min(len(btf.view), MAX_VIEWS) * lights
    return STACK_COPIES * FLOAT * pictures * btf.texel_count


def _refit(btf: BTF, config: FitConfig, found: int) -> int:
    """What the last fit to the pictures holds: lookups, lobes, a view, the matrix of weights."""
    residual, mixed = config.residual, _may_be_mixed(btf, config)
    if not mixed and residual.rank == 0 and config.storage.weights == "float32":
        return 0
    texels, views = btf.texel_count, len(btf.view)
    lookups = texels * (views if mixed else 1) * LOOKUP_BYTES + texels * views * SQUARE_BYTES
    picture = PICTURE_COPIES * FLOAT * texels * len(btf.light) * btf.channels
    atoms = 2 * FLOAT * btf.pair_count * found  # those of the dictionary are still held
    lobes = config.select.max_lobes or TEXEL_LOBES
    around = (AROUND if mixed else 1) * PLACE_BYTES * texels * lobes**2
    products = min(PRODUCT_BYTES, FLOAT * views * found**2)
    functions = 2 * FLOAT * btf.pair_count * btf.channels * residual.rank
    return lookups + picture + atoms + around + products + functions


def _may_be_mixed(btf: BTF, config: FitConfig) -> bool:
    """Whether a relief may be found, through which a pixel shows several texels."""
    large = min(btf.height, btf.width) >= LEAST_SIDE and len(btf.view) >= LEAST_VIEWS
    return config.relief.mode != "off" and btf.names is None and large
