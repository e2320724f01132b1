"""Weights and residual fit to the pictures themselves, through the relief, in Gram form."""
