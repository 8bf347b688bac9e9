"""Opens the templates of texts that are no HTML: C, Python, YAML, Markdown."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import jinja2

import templates


@cache
def text_templates(
    folder: str = "", *, strips: bool = False, **filters: Callable[[str], str]
) -> jinja2.Environment:
    """The templates of a folder of `templates/`; those that `strips` indent their own directives.

    What a spec says arrives as text that is safe where it stands: nothing is escaped here. Kept, as
    its templates are: compiling them takes longer than filling them in.
    """
    environment = jinja2.Environment(
        # found through the package: a wheel has the templates elsewhere than the repository
        loader=jinja2.FileSystemLoader(Path(templates.__path__[0]) / folder),
        # a name that the template has and the code has not is an error, not an empty place
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=strips,
        autoescape=False,  # noqa: S701  (not HTML)
    )
    environment.filters.update(filters)
    return environment
