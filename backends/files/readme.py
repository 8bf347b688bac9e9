"""Fills the README that stands beside exported files."""

from __future__ import annotations

from pathlib import Path

import jinja2

import templates


def readme_text(target: str, **facts: str | bool) -> str:
    """The text of `templates/<target>/README.md.j2` with these facts; a missing one is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(templates.__path__[0])),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        autoescape=False,  # noqa: S701  (Markdown, not HTML)
    )
    return environment.get_template(f"{target}/README.md.j2").render(**facts)


def one_line(text: str) -> str:
    """Text of a spec as Markdown may show it in a heading: one line, no code or HTML in it."""
    return " ".join(text.split()).replace("`", "'").replace("<", "‹").replace(">", "›")
