"""Maps and charts of a model: clusters, number of lobes of each texel, lobes by model."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf import MODEL_NAMES, REGISTRY
from ..model.spmm import SPMM
from ..render.display import Codes
from .charts import Bar, bar_chart, histogram
from .pictures import cluster_colours, css_colour, heat_colours
from .relief import height_map
from .views import Chart, Picture
from .wording import percent, plural


@dataclass(frozen=True)
class Maps:
    """Clusters and lobes of a model.

    Attributes:
        clusters: the cluster of each texel.
        lobes: the number of lobes of each texel.
        histogram: texels by number of lobes; its colours explain those of `lobes`.
        models: lobes by model.
        heights: the relief; None without one.
    """

    clusters: Picture
    lobes: Picture
    histogram: Chart
    models: Chart
    heights: Picture | None


def model_maps(model: SPMM) -> Maps:
    """All maps and charts of a model."""
    number = model.lobe_count_per_texel().cpu()  # [T]
    counts = torch.bincount(number).tolist()
    colours = heat_colours(len(counts))
    return Maps(
        _clusters(model),
        _lobes(model, number, colours),
        _histogram(counts, colours),
        _models(model),
        None if model.relief is None else height_map(model, model.relief),
    )


def texel_map(
    model: SPMM, index: Tensor, colours: Codes, alternative: str, caption: str
) -> Picture:
    """A picture of the colour `colours[index[t]]` for each texel t.

    Args:
        model: its texture gives the size of the picture.
        index: index of the colour of each texel, `[T]`.
        colours: `[N, 3]`.
        alternative, caption: of the picture.
    """
    codes = colours[index.cpu().numpy()].reshape(model.height, model.width, 3)
    return Picture.of_texels(codes, alternative, caption)


def _clusters(model: SPMM) -> Picture:
    sizes = torch.bincount(model.labels.cpu(), minlength=model.cluster_count)
    caption = (
        f"{plural(model.cluster_count, 'cluster')} of {int(sizes.min()):,} to "
        f"{plural(int(sizes.max()), 'texel')}, one colour each."
    )
    return texel_map(
        model, model.labels, cluster_colours(model.cluster_count), "Cluster map", caption
    )


def _lobes(model: SPMM, number: Tensor, colours: Codes) -> Picture:
    """The map of the number of lobes `[T]`."""
    caption = (
        f"{int(number.min())} to {int(number.max())}, "
        f"{number.double().mean().item():.2f} on average. Colours as in the histogram."
    )
    return texel_map(model, number, colours, "Map of the number of lobes of each texel", caption)


def _histogram(counts: list[int], colours: Codes) -> Chart:
    bars = [
        Bar(str(lobes), texels, f"{texels:,}", css_colour(colours[lobes]))
        for lobes, texels in enumerate(counts)
    ]
    title = "Texels by number of lobes"
    return Chart(title, histogram(bars, "lobes of a texel", title))


def _models(model: SPMM) -> Chart:
    use = model.lobe_use_by_model()
    stored = Counter(model.dictionary.names())
    total = sum(use.values())
    bars = [
        Bar(
            REGISTRY[MODEL_NAMES.index(name)].title,
            entries,
            f"{percent(entries / max(total, 1))} · {stored[name]:,} stored",
        )
        for name, entries in use.items()
    ]
    caption = (
        f"Percentage of the {total:,} lobes that texels use, and how many lobes of each model the "
        "dictionaries store."
    )
    return Chart("Lobes by model", bar_chart(bars, "Lobes by model"), caption)
