"""Fills the README that stands beside exported files."""

from __future__ import annotations

from backends.files.text_templates import text_templates


def readme_text(target: str, **facts: str | bool) -> str:
    """The text of `templates/<target>/README.md.j2` with these facts; a missing one is an error."""
    return text_templates().get_template(f"{target}/README.md.j2").render(**facts)


def one_line(text: str) -> str:
    """Text of a spec as Markdown may show it in a heading: one line, no code or HTML in it."""
    return " ".join(text.split()).replace("`", "'").replace("<", "‹").replace(">", "›")
