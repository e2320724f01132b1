"""The neural BTF without parallax, trained for the time of our fit and longer."""

from __future__ import annotations

from .neural_btf import NeuralBTF
from .problem import Peer, Problem, Row
from .training import trained_rows


def run(problem: Problem) -> list[Row]:
    """Trains for the time of our own fit, and for multiples of it."""
    return trained_rows(problem, "neural BTF", NeuralBTF)


PEER = Peer("neural BTF", "a latent texture and a small network, trained for a given time", run)
