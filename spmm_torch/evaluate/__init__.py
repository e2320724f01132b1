"""Quality of a model: errors, similarity of pictures, worst places: `spmm evaluate RUN`.

`looks` renders and scores the pictures that `fit` reports; `judge` makes all figures of
`evaluation.json`; `figures_of` holds anything that gives pictures of slices against a BTF.
"""

from .judge import Judgement, Likeness, Looks, judge, likeness, looks
from .opening import opening_section
from .slices import SliceFigures, figures_of, slice_figures
from .source import Source, open_source
from .sphere_section import sphere_section

__all__ = [
    "Judgement",
    "Likeness",
    "Looks",
    "SliceFigures",
    "Source",
    "figures_of",
    "judge",
    "likeness",
    "looks",
    "open_source",
    "opening_section",
    "slice_figures",
    "sphere_section",
]
