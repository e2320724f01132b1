"""Quality of a model: errors, similarity of pictures, worst places: `spmm evaluate RUN`.

`likeness` renders and scores the sphere pictures that `fit` reports; `judge` makes all figures of
`evaluation.json`.
"""

from .judge import Judgement, Likeness, judge, likeness
from .source import Source, open_source
from .sphere_section import sphere_section

__all__ = [
    "Judgement",
    "Likeness",
    "Source",
    "judge",
    "likeness",
    "open_source",
    "sphere_section",
]
