"""A BTF from ordinary texture maps: `spmm synthesize`, path-traced by Mitsuba 3.

    spmm synthesize --height H.png --albedo A.png --roughness R.png --relief 0.05 -o X.zip

or, in Python,

    maps = read_maps(height="H.png", albedo="A.png", roughness="R.png")
    synthesize_btf(maps, "X.npz", SynthesisSettings(relief=0.05, size=64))

What is traced. The height map is a surface of real triangles, repeated periodically; black lies
`relief` texture widths under white. Its mean height is z = 0, the reference plane, to which all
pictures are registered as those of a gonioreflectometer are: the value of texel p under view wo is
what orthographic rays along -wo through the footprint of p in that plane meet. A point of height h
at q is therefore seen at p = q - h wo_xy / wo_z. Light comes from one direction at a time; the path
tracer accounts for shadows, masking and inter-reflection. The material is Mitsuba's `principled`.

What the values are. Radiance under a light that gives unit irradiance to a surface that faces it:
f_r cos(theta_l) in 1/sr, which is what the evaluation of a BSDF returns. A white Lambertian plane
gives cos(theta_l) / pi. `scale` tells what becomes of them: "none" leaves them so, "auto" does the
same for HDR targets (NPZ, EXR), where nothing is ever clamped, and divides by their 99.8th
percentile for 8-bit targets (zip); what lies above 1 there is clipped, counted and reported.

What it takes. 64 x 64 texels under 81 x 81 directions at 24 samples: 3 to 7 minutes on two cores
with a libLLVM of 19 or newer (found by itself, or named by DRJIT_LIBLLVM_PATH), two to three times
that without. Time grows with texels, samples and pictures. Beside the output, the pictures need
4 bytes a value of disk while it runs.
"""

from ..config.synthesis import SynthesisSettings
from .maps import TextureMaps, read_maps
from .pipeline import synthesize_btf

__all__ = ["SynthesisSettings", "TextureMaps", "read_maps", "synthesize_btf"]
