"""Pages from the Jinja2 templates in `templates/`; every value is escaped."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..runtime.atomic import readable
from . import wording

FILTERS = (
    wording.decibels,
    wording.fixed,
    wording.median_time,
    wording.number,
    wording.percent,
    wording.plural,
    wording.ratio,
    wording.seconds,
    wording.short_seconds,
    wording.signed,
    wording.size,
    wording.three_figures,
)


def render_template(name: str, page: object) -> str:
    """The text of a page.

    Args:
        name: file in `templates/`.
        page: what the template calls `page`; its texts are escaped unless they are `Markup`.

    Raises:
        jinja2.UndefinedError: the template asks for a value that `page` lacks.
    """
    return readable(_environment().get_template(name).render(page=page))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("spmm_torch.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {function.__name__: function for function in FILTERS}
    return environment
