"""One layered surface a texel in place of lobes, fit to how the lobes look.

`fit.py` is the same for all; a parametrization (`gltf.py`, `openpbr.py`) evaluates its surface as
the renderers of that standard do.
"""
