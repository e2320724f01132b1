"""Batched solvers: pure tensor maths that knows nothing of BRDFs or textures."""
