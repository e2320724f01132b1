"""Reader of RTI and photometric-stereo sets: pictures from straight above, one for each light.

A folder or zip holds the pictures and a list of their lights, `.lp`, described in `light_list`; the
list itself may be given, too. Values are divided by the intensities of the lights, where there are
any, and contain the cosine of the light, as every photograph does.
"""

from __future__ import annotations

import math
import posixpath
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from ..errors import DataError
from .btf import BTF
from .left_out import left_out_notes
from .light_list import Light, parse_intensities, parse_lights
from .options import DEFAULT_OPTIONS, ReadOptions
from .picture_grid import PictureGrid
from .picture_set import PictureSet
from .pictures import is_container, list_files, material_name, open_archive, shown

EXPECTED = "pictures with an .lp list of their lights (RTI)"
SUFFIX = ".lp"
INTENSITIES = "light_intensities.txt"
ABOVE = (0.0, 0.0)  # the one view, theta and phi in degrees
ONE_VIEW = "note: one view, from straight above: what other views would show is a guess"


def accepts(path: Path) -> bool:
    """Whether a path is a list of lights, or a folder or zip that holds one."""
    if is_container(path):
        return bool(_lists(list_files(path)))
    return path.is_file() and path.suffix.lower() == SUFFIX


def _lists(files: Sequence[str]) -> list[str]:
    return shown([name for name in files if name.lower().endswith(SUFFIX)])


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens an RTI set: reads the list of its lights, and decodes one picture only.

    Raises:
        DataError: the list is malformed, names pictures that are not there, or lights that cannot
            be; or the first picture is damaged.
    """
    given = Path(path)
    source = given if is_container(given) else given.parent
    files = list_files(source)
    name = _the_list(source, files) if source == given else given.name
    lights = parse_lights(_text(source, name), f"{source / name}")
    grid = PictureGrid(
        (ABOVE,),
        tuple(_angles(light.direction) for light in lights),
        tuple(_picture_names(source, name, lights, files)),
    )
    pictures = PictureSet.of(source, grid, options, _intensity(source, name, lights, files))
    notes = (ONE_VIEW, *left_out_notes(source, files, grid.files))
    return pictures.btf(str(path), material_name(given), notes)


def _the_list(source: Path, files: Sequence[str]) -> str:
    lists = _lists(files)
    if len(lists) > 1:
        raise DataError(
            f"{source} holds {len(lists)} lists of lights, {lists[0]!r} and {lists[1]!r} among "
            f"them; expected one; give the path of one of them, or remove the others."
        )
    return lists[0]


def _text(source: Path, name: str) -> str:
    """The content of a text file, of any encoding in which numbers are ASCII."""
    with open_archive(source) as archive:
        archive.check([name])
        (content,) = archive.read([name])
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _picture_names(
    source: Path, list_name: str, lights: Sequence[Light], files: Sequence[str]
) -> list[str]:
    """The file of each light's picture: by its path from the list or from the top, or by its name.

    Lists often hold paths of the machine where they were made.

    Raises:
        DataError: pictures are not there, or twice, or serve two lights.
    """
    place = posixpath.dirname(list_name)
    known = {file.lower(): file for file in files} | {file: file for file in files}
    by_base: dict[str, list[str]] = {}
    for file in files:
        by_base.setdefault(posixpath.basename(file).lower(), []).append(file)
    found: dict[str, Light] = {}
    lost = []
    for light in lights:
        wanted = light.picture.replace("\\", "/")
        paths = (posixpath.normpath(posixpath.join(place, wanted)), wanted)
        spelled = [each for path in paths for each in (path, path.lower())]
        exact = [known[each] for each in spelled if each in known]
        candidates = exact[:1] or by_base.get(posixpath.basename(wanted).lower(), [])
        if not candidates:
            lost.append(light)
            continue
        _check_single(source / list_name, light, candidates, found)
        found[candidates[0]] = light
    if lost:
        raise DataError(
            f"{source / list_name} names {len(lost)} pictures that are not in {source}, such as "
            f"{lost[0].picture!r} in line {lost[0].line}; expected a picture for each light; "
            f"restore them, give the folder that holds list and pictures, or remove the lines."
        )
    return list(found)


def _check_single(
    where: Path, light: Light, candidates: Sequence[str], found: dict[str, Light]
) -> None:
    """Refuses a picture that might be another one, or has a light already."""
    if len(candidates) > 1:
        raise DataError(
            f"line {light.line} of {where} names {light.picture!r}, which may be {candidates[0]!r} "
            f"or {candidates[1]!r}; expected one; write its path from the list."
        )
    if candidates[0] in found:
        raise DataError(
            f"lines {found[candidates[0]].line} and {light.line} of {where} name the same picture, "
            f"{candidates[0]!r}; expected a picture for each light; mend one of them."
        )


def _intensity(
    source: Path, list_name: str, lights: Sequence[Light], files: Sequence[str]
) -> Tensor | None:
    """The intensity of each light by channel, `[L, 3]`; None if none is given.

    Raises:
        DataError: some lights have one and others none, or two files say them.
    """
    given = [light.intensity for light in lights]
    where, beside = source / list_name, posixpath.join(posixpath.dirname(list_name), INTENSITIES)
    if beside in files:
        if any(given):
            raise DataError(
                f"intensities of lights are in {where} and in {INTENSITIES}; expected them in one "
                f"of the two; remove those that do not hold."
            )
        given = parse_intensities(_text(source, beside), f"{source / beside}", len(lights))
    if not any(given):
        return None
    if not all(given):
        light = next(light for light in lights if not light.intensity)
        raise DataError(
            f"line {light.line} of {where} has no intensity, but others have; expected one for "
            f"each light or for none; add it."
        )
    return torch.tensor([values * 3 if len(values) == 1 else values for values in given])


def _angles(direction: tuple[float, float, float]) -> tuple[float, float]:
    """Theta and phi in degrees of a unit vector."""
    x, y, z = direction
    return math.degrees(math.atan2(math.hypot(x, y), z)), math.degrees(math.atan2(y, x)) % 360.0
