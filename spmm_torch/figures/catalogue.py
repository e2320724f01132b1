"""Every figure by its name; another figure is one module and one entry here."""

from __future__ import annotations

from .comparison import draw_comparison
from .edited import edited_figures
from .figure import Figure
from .sampling import draw_sampling

FIGURES: dict[str, Figure] = {
    figure.name: figure
    for figure in (
        Figure("figure3", "Figure 3: renderings of original and model", draw_comparison),
        *edited_figures(),
        Figure("figure10", "Figure 10: importance sampling", draw_sampling),
    )
}
