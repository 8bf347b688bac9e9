"""Prose of the documentation has lines that can be read where no browser wraps them.

A row of a table is a line in Markdown, and code, commands in comments and links cannot be broken.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.blocks import without_code
from tests.docs.page_run import ROOT

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*/README.md")),
    *sorted((ROOT / "msnn" / "features").glob("*/README.md")),
    ROOT / "editors" / "vscode" / "README.md",
]
_ONE_LINE = re.compile(r"\s*(?:\||!?\[.*\]\(.*\)[.,;]?$|\S+$)")

_COMMENT = re.compile(r"^<!--.*?-->", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_prose_has_lines_of_100_columns(page: Path):
    text = _COMMENT.sub(lambda found: "\n" * found[0].count("\n"), without_code(page))
    long = [
        n
        for n, line in enumerate(text.split("\n"), 1)
        if len(line) > 100 and not _ONE_LINE.match(line)
    ]
    assert not long, f"{page.relative_to(ROOT)}: wrap the lines {long}"
