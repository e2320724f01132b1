"""RGL `.bsdf`: a BRDF measured where its own visible normals lie [DJ18].

Values stand over numbers in the unit square that importance sampling turns into half vectors, for
each direction (phi_i, theta_i); `eval` goes the way back, as Mitsuba's BSDF `measured` does. Files
of three channels are read; those of spectra need the sensitivities of an observer first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import DataError
from .merl import polar_angle
from .slices import Slices
from .tensor_file import MAGIC, read_tensors

SUFFIX = ".bsdf"
TITLE = "RGL .bsdf"
HEADER = MAGIC
CHANNELS = 3
# Axes of the arrays that must be there.
AXES = {"phi_i": 1, "theta_i": 1, "ndf": 2, "sigma": 2, "vndf": 4, "rgb": 5, "jacobian": 1}
# Azimuths of an isotropic BRDF at most, and the parts into which symmetry divides the others.
ISOTROPIC_AZIMUTHS = 2
HALF, QUARTER = 2, 4


@dataclass(frozen=True)
class MeasuredBRDF:
    """The tables of one file.

    Attributes:
        ndf: density of normals; sigma: projected area; both over the square of a direction.
        vndf: density of visible normals, over (phi_i, theta_i).
        rgb: values over (phi_i, theta_i) and channel.
        isotropic: whether azimuths count from phi_i only.
        reduction: into how many equal parts symmetry divides phi_i; 1: none.
        jacobian: whether values are divided by what `ndf` and `sigma` tell.
    """

    ndf: Slices
    sigma: Slices
    vndf: Slices
    rgb: Slices
    isotropic: bool
    reduction: int
    jacobian: bool

    def eval(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """The BRDF times the cosine of the light, `[Q, 3]` in 1/sr.

        Args:
            wi, wo: unit directions of light and view `[Q, 3]` float64, over the horizon.
        """
        view, light = self._turned(wo, wi)
        half = view + light
        half = half / np.linalg.norm(half, axis=1, keepdims=True)
        phi, theta = np.arctan2(view[:, 1], view[:, 0]), polar_angle(view)
        azimuth = np.arctan2(half[:, 1], half[:, 0]) - (phi if self.isotropic else 0.0)
        normal = _square(polar_angle(half), azimuth)
        at = (phi, theta)
        sample = self.vndf.invert(normal, at)
        channels = [
            self.rgb.eval(sample, (*at, np.full(len(phi), float(channel))))
            for channel in range(CHANNELS)
        ]
        values = np.stack(channels, axis=1)
        if self.jacobian:
            area = self.sigma.eval(_square(theta, phi))
            values *= (self.ndf.eval(normal) / (4.0 * area))[:, None]
        return values

    def _turned(self, view: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both directions `[Q, 3]`, mirrored or turned so that the view is in the measured part."""
        if self.reduction < HALF:
            return view, light
        y = np.where(view[:, 1] < 0.0, 1.0, -1.0)
        x = np.where(view[:, 0] < 0.0, 1.0, -1.0) if self.reduction == QUARTER else y
        signs = np.stack((x, y, np.ones_like(x)), axis=1)
        return view * signs, light * signs


def _square(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Points `[Q, 2]` of the unit square for polar angles and azimuths `[Q]`."""
    around = (phi + math.pi) / (2.0 * math.pi)
    return np.stack((np.sqrt(theta * 2.0 / math.pi), around - np.floor(around)), axis=1)


def parse(payload: bytes, where: str) -> MeasuredBRDF:
    """The tables of a file.

    Raises:
        DataError: it is damaged, holds spectra, or lacks a table.
    """
    tensors = read_tensors(payload, where)
    if "spectra" in tensors and "rgb" not in tensors:
        raise DataError(
            f"{where} holds spectra; expected the RGB file of this material, whose name ends in "
            f"_rgb.bsdf; take that one from the database instead."
        )
    _check(tensors, where)
    known = {name: tensors[name].astype(np.float64) for name in AXES}
    phi, theta = known["phi_i"], known["theta_i"]
    isotropic = len(phi) <= ISOTROPIC_AZIMUTHS
    return MeasuredBRDF(
        ndf=Slices(known["ndf"]),
        sigma=Slices(known["sigma"]),
        vndf=Slices(known["vndf"], (phi, theta)),
        rgb=Slices(known["rgb"], (phi, theta, np.arange(CHANNELS, dtype=np.float64))),
        isotropic=isotropic,
        reduction=1 if isotropic else round(2.0 * math.pi / float(phi[-1] - phi[0])),
        jacobian=bool(known["jacobian"][0]),
    )


def _check(tensors: dict[str, np.ndarray], where: str) -> None:
    """Checks that all tables are there, with axes that belong together."""
    for name, axes in AXES.items():
        if name not in tensors or tensors[name].ndim != axes or not tensors[name].size:
            found = f"axes {list(tensors[name].shape)}" if name in tensors else "no such array"
            raise DataError(
                f"{where} has {found} for {name!r}; expected {axes} axes, as RGB files of the RGL "
                f"database have; take the file from there."
            )
    count = (tensors["phi_i"].size, tensors["theta_i"].size)
    vndf, rgb = tensors["vndf"].shape, tensors["rgb"].shape
    squares = (vndf[2:], rgb[3:], tensors["ndf"].shape, tensors["sigma"].shape)
    if (
        vndf[:2] != count
        or rgb[:3] != (*count, CHANNELS)
        or min(map(min, squares)) < 2  # corners of a patch
    ):
        raise DataError(
            f"{where} has 'vndf' of {list(vndf)} and 'rgb' of {list(rgb)} for {count[0]} azimuths "
            f"and {count[1]} polar angles; expected axes that agree; take the file from the "
            f"database again."
        )
