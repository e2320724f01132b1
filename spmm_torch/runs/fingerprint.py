"""What the finished stages of a run depend on: the content of its input, and its settings."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from .. import __version__
from ..config.fit import FitConfig
from ..data import BTF
from ..data.cache import file_hash
from ..data.error_weights import Weights
from ..errors import DataError

STATE_VERSION = 4  # of the files of finished stages
# Keys that tell by which release a state was made, and those of contents, which are hashes.
RELEASE = ("version", "state")
CONTENTS = {
    "input": "the input",
    "weights": "the weights of errors",
    "relief.height": "the heights",
}
# Settings that name files whose content is among the facts: how they are named does not count.
NAMES_ONLY = ("weights.scene", "weights.file")
HEIGHTS = "relief.height"
# Settings that name files, of which a finished run keeps no content, and that of the machine.
FILES, MACHINE = (*NAMES_ONLY, HEIGHTS), "device"


def fingerprint(btf: BTF, config: FitConfig, weights: Weights) -> dict[str, Any]:
    """All values that the finished stages of a run depend on, as flat JSON.

    Args:
        btf: the input, which is read once for it, unless it is a zip with checksums.
        config: of the fit.
        weights: of the errors, as the user gave them.

    Raises:
        DataError: the input or the picture of heights cannot be read any more.
    """
    settings = _flat(config.to_dict())
    for name in NAMES_ONLY:
        del settings[name]
    if settings[HEIGHTS] is not None:
        settings[HEIGHTS] = _content_of(Path(settings[HEIGHTS]))
    facts = {
        "version": __version__,
        "state": STATE_VERSION,
        "input": btf.identity(),
        "shape": [btf.height, btf.width, len(btf.view), len(btf.light)],
        "weights": weights.digest(),
    }
    return facts | settings


def key_of(facts: dict[str, Any] | None) -> str:
    """The hash of a fingerprint, in hexadecimal; empty for None."""
    if facts is None:
        return ""
    text = json.dumps(facts, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def contents_of(facts: dict[str, Any]) -> dict[str, Any]:
    """What a finished run keeps of a fingerprint: the hashes of contents, and by which release."""
    return {key: facts[key] for key in (*RELEASE, *CONTENTS)}


def difference(before: dict[str, Any], now: dict[str, Any]) -> str:
    """In what two fingerprints differ, as the end of "the unfinished run of RUN has ..."."""
    key = next(key for key in {**before, **now} if before.get(key) != now.get(key))
    if key in CONTENTS:
        return f"other content of {CONTENTS[key]}, which has changed since or is another one"
    return f"{key} = {before.get(key)!r}, not {now.get(key)!r}"


def differing_setting(before: FitConfig, now: FitConfig) -> str | None:
    """In what the settings of a finished run differ, as by `difference`; None if in nothing.

    The device does not count, and files are told by their last names.
    """
    rows = [_flat(each.to_dict()) for each in (before, now)]
    for row in rows:
        del row[MACHINE]
        row.update({name: Path(row[name]).name for name in FILES if row[name] is not None})
    return None if rows[0] == rows[1] else difference(*rows)


def _content_of(path: Path) -> str:
    try:
        return file_hash(path)
    except OSError as error:
        raise DataError(
            f"height map {path} cannot be read ({error}); expected a grey picture; check the path."
        ) from error


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for key, value in values.items():
        nested = isinstance(value, dict)
        rows |= _flat(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
    return rows
