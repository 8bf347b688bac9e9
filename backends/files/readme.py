"""Renders the README of exported files."""

from __future__ import annotations

from backends.files.text_templates import text_templates


def readme_text(target: str, **facts: str | bool) -> str:
    """Renders `templates/<target>/README.md.j2`; a missing fact is an error."""
    return text_templates().get_template(f"{target}/README.md.j2").render(**facts)


def one_line(text: str) -> str:
    """Text of a spec for a Markdown heading: one line, without code or HTML."""
    return " ".join(text.split()).replace("`", "'").replace("<", "‹").replace(">", "›")
