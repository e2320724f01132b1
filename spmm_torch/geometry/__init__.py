"""Directions, frames, warps and interpolation over the hemisphere."""
