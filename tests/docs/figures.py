"""Finds the figures of a page that look measured, each with what the page says of them.

A comment stands above a paragraph, a list or a table, and speaks of all of it:

| comment | its figures |
|---|---|
| `<!-- figures of: FILE -->` | are in the file that the measurement writes, relative to the page |
| `<!-- figures of: links -->` | of each row of a table are in the files that the row links to |
| `<!-- figures by: FILE -->` | are compared by that test, which names the page |
| `<!-- figures given: WHAT -->` | were not measured: limits, settings, definitions |

Between `<!-- figures -->` and `<!-- end -->` stands what an example writes, of which its test
compares all. What commands print in a page is compared by `page_run`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tests.docs.blocks import without_code

_COMMENT = re.compile(r"<!-- figures (of|by|given): (.+?) -->")
_WRITTEN = re.compile(r"^<!-- (?:generated: .*?|figures) -->$.*?^<!-- end -->$", re.M | re.S)
_NOT_SHOWN = re.compile(r"`[^`]*`|\]\([^)]*\)")
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")
_UNITS = (
    r"(?:[nµm]?s|min|minutes?|seconds?|hours?|an? (?:second|minute|hour)"
    r"|[kMGT]i?B|bytes?|bits?|ulp|times|instructions?|cycles|operations)\b|%|×"
)
# with its unit behind a blank or without one: 30 ms, 30ms, 1.7x
_SHOWN = re.compile(
    rf"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?:(?=(?:{_UNITS})|x\b)|(?!\w|\.\d+[A-Za-z]))"
)
_SCALES = r"(?: (?:thousand|million|billion))?"
_LOOKS_MEASURED = re.compile(
    rf"(?<![\w.\[])\d[\d,]*(?:\.\d+)?(?:e-?\d+)?{_SCALES}\s?(?:{_UNITS})"
    r"|\bMeasured (?:on|over|by|with|along)\b"
)


@dataclass(frozen=True)
class Passage:
    """A paragraph, list or table, its first line, and what a comment says of its figures."""

    text: str
    line: int
    kind: str = ""
    """`of`, `by`, `given`; empty where nothing is said."""
    about: str = ""

    @property
    def figures(self) -> list[str]:
        """Numbers with a unit that machines are measured in: time, memory, shares, factors, bits.

        Lengths, voltages and the like are of the systems that models are of, unless the passage
        says that it tells of a measurement.
        """
        shown = _NOT_SHOWN.sub(" ", self.text).replace("\n", " ")
        return [found[0] for found in _LOOKS_MEASURED.finditer(shown)]


def passages_of(page: Path) -> list[Passage]:
    """The passages of a page without its code and what tests and examples write into it."""
    text = _WRITTEN.sub(lambda found: "\n" * found[0].count("\n"), without_code(page))
    passages: list[Passage] = []
    kind = about = ""
    lines: list[str] = []
    for number, line in enumerate([*text.split("\n"), ""], 1):
        said = _COMMENT.fullmatch(line)
        if said is not None:
            kind, about = said[1], said[2]
        elif line.strip():
            lines.append(line)
        elif lines:
            passages.append(Passage("\n".join(lines), number - len(lines), kind, about))
            kind, about, lines = "", "", []
    return passages


def not_measured(text: str, results: str) -> list[str]:
    """Numbers of a text that no number of the results gives when it is rounded to their digits."""
    known = [float(number) for number in _NUMBER.findall(_ungrouped(results))]
    shown = _SHOWN.findall(_ungrouped(_NOT_SHOWN.sub(" ", text)))
    return [number for number in shown if not any(_rounds(one, number) for one in known)]


def _ungrouped(text: str) -> str:
    """A text with 12,345 as 12345."""
    return re.sub(r"(?<=\d),(?=\d{3}(?!\d))", "", text)


def _rounds(value: float, shown: str) -> bool:
    mantissa, _, power = shown.partition("e")
    digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(value - float(shown)) <= 0.5 * digit * (1 + 1e-9)
