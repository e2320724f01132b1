"""The sphere of our renderer in Mitsuba."""

from __future__ import annotations

import math
from typing import Any

from spmm_torch.render.camera import HALF_WIDTH, START


def sphere_scene(mi: Any, bsdf: dict[str, Any], lights: dict[str, Any], size: int) -> Any:
    """A unit sphere seen by parallel rays from +z, poles at +-y, as `render.Sphere` stands.

    Args:
        mi: Mitsuba, its variant set.
        bsdf: with a texture that takes one turn of the sphere twice.
        lights: parts of the scene by name.
        size: of the square picture.
    """
    transform = mi.ScalarTransform4f
    camera = transform().look_at(origin=[0, 0, START], target=[0, 0, 0], up=[0, 1, 0])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "ball": {
                "type": "sphere",
                # Its own poles are +-z, and its texture begins at +x: turned so that u = 0 is
                # behind, and half a turn of it in front.
                "to_world": transform().rotate([1, 0, 0], -90).rotate([0, 0, 1], 90),
                "bsdf": bsdf,
            },
            "sensor": {
                "type": "orthographic",
                "to_world": camera @ transform().scale([HALF_WIDTH, HALF_WIDTH, 1.0]),
                "sampler": {"type": "independent"},
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
            },
            **lights,
        }
    )


def as_on_our_sphere(mi: Any) -> Any:
    """`to_uv` by which one copy of a square texture takes half a turn, as `render.Texture` says.

    The copy in front is the same one also where every second copy is mirrored.
    """
    transform = mi.ScalarTransform4f
    return transform().translate([-0.5, 0, 0]) @ transform().scale([2, 1, 1])


def sun(direction: tuple[float, float, float]) -> dict[str, Any]:
    """Parallel light of unit irradiance from a direction."""
    length = math.sqrt(sum(x * x for x in direction))
    return {
        "type": "directional",
        "direction": [-x / length for x in direction],
        "irradiance": {"type": "rgb", "value": 1.0},
    }
