"""Where the weights of a fit come from: a scene, a file, or the compression of values."""

from .compressive import compressive_weights
from .given import given_weights
from .scene import scene_weights

__all__ = ["compressive_weights", "given_weights", "scene_weights"]
