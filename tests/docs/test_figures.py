"""Figures that a page has of a measurement are those of the file that the measurement writes.

`<!-- figures of: FILE -->` stands above a paragraph or a table; FILE is relative to the page. What
commands print in a page is compared by `page_run`, tables of examples by their own tests.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.page_run import ROOT

_MARKED = re.compile(r"^<!-- figures of: (\S+) -->\n+(.+?)(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)
_NOT_SHOWN = re.compile(r"`[^`]*`|\]\([^)]*\)")
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if _MARKED.search(page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_figure_is_measured(page: Path):
    for file, text in _MARKED.findall(page.read_text(encoding="utf-8")):
        results = (page.parent / file).read_text(encoding="utf-8")
        assert not_measured(text, results) == [], f"{page.name}: these are not in {file}"


def test_a_figure_that_was_not_measured_is_named():
    results = "damping 28.335 and 1.9e-06, 200 times"
    assert not_measured("28.3 of [200](a%2031.md) `77`, 28 and 2e-06", results) == []
    assert not_measured("28.4, 201 times or -200", results) == ["28.4", "201", "-200"]


def not_measured(text: str, results: str) -> list[str]:
    """Numbers of a text that no number of the results gives when it is rounded to their digits."""
    known = [float(number) for number in _NUMBER.findall(results)]
    shown = _NUMBER.findall(_NOT_SHOWN.sub(" ", text))
    return [number for number in shown if not any(_rounds(one, number) for one in known)]


def _rounds(value: float, shown: str) -> bool:
    mantissa, _, power = shown.partition("e")
    digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(value - float(shown)) <= 0.5 * digit * (1 + 1e-9)
