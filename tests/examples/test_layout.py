"""The specs that people read first are laid out as `msnn fmt` lays specs out."""

from __future__ import annotations

from pathlib import Path

import pytest

from spec_schema.editors.format_spec import format_spec
from tests.examples.gallery import EXAMPLES

ROOT = Path(__file__).parents[2]
SHOWN = [*EXAMPLES, *sorted(ROOT.glob("tests/language/drafts/*.yaml"))]


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.name)
def test_fmt_leaves_it_as_it_is(path: Path) -> None:
    text = path.read_bytes().decode()
    assert format_spec(str(path), text) == text
