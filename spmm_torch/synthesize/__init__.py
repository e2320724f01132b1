"""A BTF from ordinary texture maps: `spmm synthesize`, path-traced by Mitsuba 3.

    spmm synthesize --height H.png --albedo A.png --roughness R.png --relief 0.05 -o X.zip

or, in Python,

    maps = read_maps(height="H.png", albedo="A.png", roughness="R.png")
    synthesize_btf(maps, "X.npz", SynthesisSettings(relief=0.05, size=64))

Scene. The height map is a surface of triangles, repeated periodically, with black `relief` texture
widths below white. Its mean height is the reference plane z = 0, to which all pictures are
registered, as by a gonioreflectometer: texel p under view wo is seen by orthographic rays along -wo
through its footprint in that plane. A point of height h at q therefore appears at
p = q - h wo_xy / wo_z. Light comes from one direction at a time, with shadows, masking and
inter-reflection. The material is `principled` of Mitsuba.

Values. They are radiance under a light of unit irradiance on a surface that faces it, in 1/sr:
f_r cos(theta_l), as a BSDF evaluates. A white Lambertian plane has cos(theta_l) / pi. With `scale`
"none" they stay so. With "auto" they stay so in HDR targets (NPZ, EXR), which never clip, and are
divided by their 99.8th percentile in 8-bit targets (zip), where values above 1 are clipped, counted
and reported.

Cost. 64 x 64 texels under 81 x 81 directions with 24 samples take 3 to 7 minutes on two cores with
a libLLVM of 19 or newer (which is found, or named by DRJIT_LIBLLVM_PATH), and two to three times as
long without. Time is proportional to texels, samples and pictures. Besides the output, pictures
take 4 bytes a value of disk during the run.
"""

from ..config.synthesis import SynthesisSettings
from .maps import TextureMaps, read_maps
from .pipeline import synthesize_btf

__all__ = ["SynthesisSettings", "TextureMaps", "read_maps", "synthesize_btf"]
