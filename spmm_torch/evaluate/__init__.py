"""What a model is worth: errors, similarity of pictures, and where it fails: `spmm evaluate RUN`.

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
