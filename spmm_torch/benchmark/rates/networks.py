"""Neural BTFs with depth of several sizes, trained for given times."""

from __future__ import annotations

from functools import partial

from ..peers.neural_depth import DepthBTF
from ..peers.training import train
from .subject import Row, Subject


def neural_rows(subject: Subject, seconds: float) -> list[Row]:
    """Points of all sizes and times.

    Args:
        subject: the material.
        seconds: of our own fit, of which training times are multiples.
    """
    scope, rows = subject.bench.scope, []
    values = subject.btf.texels(device=subject.bench.device)
    for factor in scope.training:
        for latent in scope.latents:
            build = partial(DepthBTF, latent=latent)
            model, _ = train(build, subject.btf, values, factor * seconds)
            sizes = model.texel_bytes, model.shared_bytes
            curve, name = f"neural depth, {factor:g} x time", f"{latent} latent values"
            rows.append(subject.drawn(curve, name, model.of_view, sizes, factor * seconds))
            subject.bench.advance()
    return rows
