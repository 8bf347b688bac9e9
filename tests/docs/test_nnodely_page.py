"""The page for users of nnodely: every row names tests or cases, and they exist."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / "docs" / "nnodely.md"


def _rows() -> list[list[str]]:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    tables = [line for line in lines if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in tables]
    return [row for row in cells if row[0] != "nnodely" and not row[0].startswith("---")]


def test_every_row_names_a_test_that_exists() -> None:
    rows = _rows()
    assert len(rows) > 40
    for row in rows:
        assert len(row) == 3, row
        named = re.findall(r"`([^`]+\.(?:py|yaml))(?:::(\w+))?`", row[2])
        assert named, f"no test shows {row[0]}"
        for path, test in named:
            text = (TESTS / path).read_text(encoding="utf-8")
            shown = "x-case:" if path.endswith(".yaml") else f"def {test or 'test_'}"
            assert shown in text, f"{path}::{test}"
