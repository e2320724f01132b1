"""Weights of the errors of a fit: of a scene, of a file, or of compressed values."""

from .compressive import compression, compressive_weights
from .given import given_weights
from .scene import scene_weights

__all__ = ["compression", "compressive_weights", "given_weights", "scene_weights"]
