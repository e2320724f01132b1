"""The figures of the paper, drawn for a run: `spmm figures RUN -o OUT`."""

from .catalogue import FIGURES
from .figure import Choices, Drawing, Figure, Subject

__all__ = ["FIGURES", "Choices", "Drawing", "Figure", "Subject"]
