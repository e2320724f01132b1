"""Where the model spends its lobes: cluster map, lobes a texel, lobes by model."""

from __future__ import annotations

from collections import Counter

import torch
from torch import Tensor

from ..model.spmm import SPMM
from .charts import Bar, bar_chart, histogram
from .markup import Markup, figure, join, picture, tag
from .pictures import Codes, cluster_colours, css_colour, heat_colours, png_uri
from .slices import SHOWN_WIDTH
from .wording import plural


def maps_section(model: SPMM) -> Markup:
    """Clusters, numbers of lobes and models of lobes."""
    panels = (_clusters(model), _models(model), *_lobes(model))
    grid = tag("div", *(tag("div", panel, class_="panel") for panel in panels), class_="panels")
    return join((tag("h2", "Clusters and lobes"), grid))


def texel_map(model: SPMM, index: Tensor, colours: Codes, alternative: str) -> Markup:
    """A picture of the colour `colours[index[t]]` for each texel t."""
    codes = colours[index.cpu().numpy()].reshape(model.height, model.width, 3)
    image = picture(png_uri(codes), alternative, pixelated=model.width < SHOWN_WIDTH)
    return tag("div", image, class_="map")


def _clusters(model: SPMM) -> Markup:
    sizes = torch.bincount(model.labels.cpu(), minlength=model.cluster_count)
    image = texel_map(model, model.labels, cluster_colours(model.cluster_count), "Cluster map")
    caption = (
        f"{plural(model.cluster_count, 'cluster')} of {int(sizes.min()):,} to "
        f"{plural(int(sizes.max()), 'texel')}, one colour each."
    )
    return join((tag("h3", "Clusters"), figure(image, caption)))


def _lobes(model: SPMM) -> tuple[Markup, Markup]:
    """The map of the number of lobes, and its histogram, which is the legend of the map too."""
    number = model.lobe_count_per_texel().cpu()  # [T]
    counts = torch.bincount(number).tolist()
    colours = heat_colours(len(counts))
    image = texel_map(model, number, colours, "Map of the number of lobes of each texel")
    bars = [
        Bar(str(lobes), texels, f"{texels:,}", css_colour(colours[lobes]))
        for lobes, texels in enumerate(counts)
    ]
    chart = histogram(bars, "lobes of a texel", "Number of texels by number of lobes")
    spread = (
        f"{int(number.min())} to {int(number.max())}, "
        f"{number.double().mean().item():.2f} on average. Colours as in the histogram."
    )
    return (
        join((tag("h3", "Lobes of each texel"), figure(image, spread))),
        join((tag("h3", "Texels by number of lobes"), chart)),
    )


def _models(model: SPMM) -> Markup:
    use = model.lobe_use_by_model()
    stored = Counter(model.dictionary.names())
    total = max(sum(use.values()), 1)
    bars = [
        Bar(
            name.replace("_", "-").title(),
            entries,
            f"{100.0 * entries / total:.1f} % · {stored[name]:,} stored",
        )
        for name, entries in use.items()
    ]
    caption = (
        f"Share of the {sum(use.values()):,} lobes that texels use, and how many lobes of each "
        "model the dictionaries store."
    )
    chart = bar_chart(bars, "Lobes by model")
    return join((tag("h3", "Lobes by model"), figure(chart, caption)))
