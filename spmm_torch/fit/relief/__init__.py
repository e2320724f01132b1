"""The relief of a BTF, found in the BTF itself: `estimate_relief(btf)`.

A point of height h over plane position x shows, under a view wo, at p = x - h s with
s = wo_xy / wo_z. Where all views are read at p, they show the same point and agree under each
light: the height of a texel is the one at which they agree best, a plane sweep [Col96]. Heights
are in units of the texture's width over the plane in which pictures were rectified.

References:
    [Col96] Robert T. Collins, A Space-Sweep Approach to True Multi-Image Matching, CVPR 1996.
    [Hir08] Heiko Hirschmüller, Stereo Processing by Semiglobal Matching and Mutual Information,
        IEEE Transactions on Pattern Analysis and Machine Intelligence 30(2), 2008.
    [LK81] Bruce D. Lucas, Takeo Kanade, An Iterative Image Registration Technique with an
        Application to Stereo Vision, IJCAI 1981.
"""

from .estimate import Estimate, estimate_relief

__all__ = ["Estimate", "estimate_relief"]
