"""What a picture states of its own colours: a gamma, or a colour profile other than sRGB.

Pictures are read by the setting `data.gamma`, and as sRGB; where they say otherwise, whoever reads
them ought to know.
"""

from __future__ import annotations

import io

from PIL import Image, ImageCms

# Formats whose headers Pillow reads.
FORMATS = ("JPEG", "PNG", "WEBP", "TIFF")
# How far a stated gamma may be from the setting: 2.2 stands for the curve of sRGB.
TOLERANCE = 0.1


def colour_notes(payload: bytes, gamma: float) -> tuple[str, ...]:
    """Lines about a picture that states another gamma, or other colours, than it is read with.

    Args:
        payload: the file of the picture.
        gamma: exponent that its codes are read with.
    """
    try:
        with Image.open(io.BytesIO(payload), formats=FORMATS) as image:
            info = dict(image.info)
    except (OSError, ValueError, SyntaxError):  # no such format; its codec tells what is damaged
        return ()
    if name := _profile_name(info.get("icc_profile")):
        return (f"note: pictures have the colour profile {name!r}, and are read as sRGB",)
    stated = info.get("gamma")
    if not stated or "srgb" in info or abs(1.0 / stated - gamma) <= TOLERANCE * gamma:
        return ()
    own = f"{1.0 / stated:.3g}"
    return (
        f"note: pictures state a gamma of {own}, and are read with {gamma:g}: data.gamma={own} "
        f"follows them",
    )


def _profile_name(profile: bytes | None) -> str | None:
    """The name of a colour profile; None for none, one that cannot be read, or sRGB."""
    if not profile:
        return None
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = ImageCms.getProfileDescription(opened).strip()
    except (ImageCms.PyCMSError, OSError):
        return None
    return None if "srgb" in name.lower() else name
