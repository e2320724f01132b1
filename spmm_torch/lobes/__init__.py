"""Rotated, cosine-weighted BRDF lobes in batches: values, gradients, samples."""
