"""The Mitsuba scene: a relief, a movable sun, and cameras with oblique parallel rays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..config.synthesis import SynthesisSettings
from .maps import TextureMaps
from .relief import ReliefMesh, build_relief, needed_margin

# Samples of the maps, and vertices of the relief, across one texel; finer detail is averaged.
DETAIL = 4
# Height of the start of rays above the highest point, in texture widths.
CLEARANCE = 0.1
NEAR, FAR = 1e-3, 1e3
# Size of the blocks of a film: random numbers depend on it, and its default on the threads.
BLOCK_SIZE = 32
SUN_PLACE = "sun.to_world"
# Smallest `specular` with metals, whose reflection `principled` of Mitsuba drops at 0.
MIN_SPECULAR_OF_METALS = 1e-4


class PathTracer:
    """Path tracer of the pictures of a texture.

    Args:
        mitsuba: module with its variant set.
        maps: texture maps.
        settings: settings, of which relief, size, samples, bounces and specular are used.
        lowest_cosine: smallest cosine of a view or light with z.
    """

    def __init__(
        self, mitsuba: Any, maps: TextureMaps, settings: SynthesisSettings, lowest_cosine: float
    ) -> None:
        self.mitsuba = mitsuba
        self.rows, self.columns = picture_size(maps, settings)
        self.strata = stratify(settings.samples)
        maps = maps.reduced(DETAIL * settings.size)
        self.aspect = maps.aspect
        margin = needed_margin(settings.relief, lowest_cosine)
        relief = build_relief(maps.height, settings.relief, margin, maps.normal)
        self.start = float(relief.position[:, 2].max()) + CLEARANCE
        self.scene = mitsuba.load_dict(self._scene(relief, maps, settings))
        self.parameters = mitsuba.traverse(self.scene)
        self.integrator = self.scene.integrator()

    def camera(self, view: np.ndarray) -> Any:
        """A camera with rays along `-view [3]` through the rectangle of the texture at z = 0.

        It is orthographic with a sheared frame: its axes are the sides of the rectangle, to which
        rays are oblique. Each texel is split into strata, which are pixels of one sample each.
        """
        across, down = self.strata
        width, height = self.columns * across, self.rows * down
        away = view / view[2]
        frame = np.eye(4)
        # The camera covers x in [-1, 1], with +x to the left, and y in [-1, 1] * height / width.
        frame[:3, 0] = (-0.5, 0.0, 0.0)
        frame[:3, 1] = (0.0, 0.5 * self.aspect * width / height, 0.0)
        frame[:3, 2] = -view
        frame[:3, 3] = np.array((0.5, 0.5 * self.aspect, 0.0)) + self.start * away
        return self.mitsuba.load_dict(
            {
                "type": "orthographic",
                "to_world": self.mitsuba.ScalarTransform4f(frame),
                "near_clip": NEAR,
                "far_clip": FAR,
                "sampler": {"type": "independent", "sample_count": 1},
                "film": {
                    "type": "hdrfilm",
                    "width": width,
                    "height": height,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
            }
        )

    def picture(self, camera: Any, light: np.ndarray, seed: int) -> np.ndarray:
        """Radiance `[H, W, 3]` under a light of unit irradiance from `light [3]`, in 1/sr."""
        self.parameters[SUN_PLACE] = self.mitsuba.ScalarTransform4f().look_at(
            origin=[0.0, 0.0, 0.0], target=(-light).tolist(), up=_any_other_axis(light)
        )
        self.parameters.update()
        # Not by mitsuba.render, which prepares gradients and replaces KeyboardInterrupt.
        image = self.integrator.render(self.scene, sensor=camera, seed=seed, spp=1)
        return self._mean_of_strata(np.array(image))

    def _mean_of_strata(self, paths: np.ndarray) -> np.ndarray:
        """Means `[H, W, 3]` over the strata of `paths [H * down, W * across, 3]`."""
        across, down = self.strata
        if not np.isfinite(paths).all():  # an overflow in one path must not spoil its texel
            paths = np.where(np.isfinite(paths), paths, 0.0)
        # Rows first: three times as fast as both axes at once.
        rows = paths.reshape(self.rows, down, -1).mean(axis=1)
        return rows.reshape(self.rows, self.columns, across, 3).mean(axis=2)

    def _scene(
        self, relief: ReliefMesh, maps: TextureMaps, settings: SynthesisSettings
    ) -> dict[str, Any]:
        """The description of the scene."""
        metallic = maps.metallic
        material = {
            "type": "principled",
            "base_color": self._texture(maps.albedo),
            "roughness": self._texture(maps.roughness),
            "metallic": 0.0 if metallic is None else self._texture(metallic),
            "specular": max(settings.specular, 0.0 if metallic is None else MIN_SPECULAR_OF_METALS),
        }
        return {
            "type": "scene",
            "relief": self._mesh(relief, self.mitsuba.load_dict(material)),
            "sun": {"type": "directional", "irradiance": {"type": "rgb", "value": 1.0}},
            "integrator": {
                "type": "path",
                "max_depth": settings.bounces + 1,
                "rr_depth": settings.bounces + 2,  # no Russian roulette, which would only add noise
                "block_size": BLOCK_SIZE,
            },
        }

    def _texture(self, picture: np.ndarray) -> dict[str, Any]:
        """A periodic bilinear texture of linear values `[h, w]` or `[h, w, 3]`."""
        # A copy, because Mitsuba refuses read-only arrays such as those of Pillow.
        layers = np.array(picture.reshape(*picture.shape[:2], -1), dtype=np.float32, order="C")
        return {"type": "bitmap", "bitmap": self.mitsuba.Bitmap(layers), "raw": True}

    def _mesh(self, relief: ReliefMesh, material: Any) -> Any:
        """The mesh of the relief."""
        properties = self.mitsuba.Properties()
        properties["material"] = material
        mesh = self.mitsuba.Mesh(
            "relief",
            vertex_count=len(relief.position),
            face_count=len(relief.faces),
            has_vertex_normals=relief.normal is not None,
            has_vertex_texcoords=True,
            props=properties,
        )
        parameters = self.mitsuba.traverse(mesh)
        parameters["vertex_positions"] = relief.position.ravel()
        if relief.normal is not None:
            parameters["vertex_normals"] = relief.normal.ravel()
        parameters["vertex_texcoords"] = relief.uv.ravel()
        parameters["faces"] = relief.faces.ravel()
        parameters.update()
        return mesh


def picture_size(maps: TextureMaps, settings: SynthesisSettings) -> tuple[int, int]:
    """Rows and columns of texels, which are square except for rounding."""
    return max(round(settings.size * maps.aspect), 1), settings.size


def stratify(samples: int) -> tuple[int, int]:
    """Strata (across, down) of a texel: the most equal factors of the number of samples."""
    down = next(n for n in range(math.isqrt(samples), 0, -1) if samples % n == 0)
    return samples // down, down


def _any_other_axis(direction: np.ndarray) -> list[float]:
    """A coordinate axis `[3]` that is not parallel to a direction `[3]`."""
    axis = [0.0, 0.0, 0.0]
    axis[int(np.abs(direction).argmin())] = 1.0
    return axis
