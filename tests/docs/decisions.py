"""The index of decisions: each room keeps its own in `decisions.md`."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

from tests.docs.markdown import table

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    p
    for room in ("spec_schema", "compiler", "backends", "msnn")
    for p in (ROOT / room).rglob("decisions.md")
)
_HEADING = re.compile(r"^## ((\d{4}) (.+))$", re.MULTILINE)


class Decision(NamedTuple):
    """A heading of a page."""

    number: str
    title: str
    anchor: str
    page: Path


def recorded(pages: list[Path] = PAGES) -> list[Decision]:
    """The decisions of these pages, in the order of their numbers."""
    headings = [(page, m) for page in pages for m in _HEADING.finditer(page.read_text("utf-8"))]
    return sorted(Decision(m[2], m[3], _anchor(m[1]), page) for page, m in headings)


def decisions() -> str:
    """One row per decision, linked to its page."""
    rows = [
        (
            f"[{number}]({os.path.relpath(page, ROOT / 'docs')}#{anchor})",
            title,
            f"`{page.parent.relative_to(ROOT)}`",
        )
        for number, title, anchor, page in recorded()
    ]
    return table(("number", "decision", "room"), rows)


def _anchor(heading: str) -> str:
    """The anchor that code hosts and the site derive from a heading."""
    words = re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")
    return re.sub("-+", "-", words)
