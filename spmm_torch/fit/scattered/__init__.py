"""Fits of scattered samples: texels under lists of pairs of directions, without a grid."""
