"""The figures of the paper for a run of one's own: `spmm figures RUN -o OUT`."""

from .catalogue import FIGURES
from .figure import Choices, Drawing, Figure, Subject

__all__ = ["FIGURES", "Choices", "Drawing", "Figure", "Subject"]
