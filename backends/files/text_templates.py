"""Opens the templates of C, Python, YAML and Markdown texts, and renders READMEs of exports."""

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
    """The jinja2 environment of a folder of `templates/`; with `strips`, directives may be
    indented. `filters` are functions that templates can use, by name. Values are inserted without
    escaping: callers pass text that is safe at its place. The result is cached, since compiling
    templates is slower than rendering them.
    """
    environment = jinja2.Environment(
        # located through the package: a wheel has another layout than the repository
        loader=jinja2.FileSystemLoader(Path(templates.__path__[0]) / folder),
        # a missing variable is an error instead of an empty text
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=strips,
        autoescape=False,  # noqa: S701  (not HTML)
    )
    environment.filters.update(filters)
    return environment


def readme_text(target: str, **facts: str | bool) -> str:
    """Renders `templates/<target>/README.md.j2` with these facts. Raises jinja2.UndefinedError for
    a missing one.
    """
    return text_templates().get_template(f"{target}/README.md.j2").render(**facts)


def one_line(text: str) -> str:
    """Text of a spec for a Markdown heading: in one line, with characters of code and HTML
    replaced.
    """
    return " ".join(text.split()).replace("`", "'").replace("<", "‹").replace(">", "›")
