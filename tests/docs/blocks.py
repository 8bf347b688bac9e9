"""Reads the code blocks of a page, each with the comments before it that say what it is.

A comment is invisible to readers: `<!-- before: cp $ROOT/… log.csv -->` above a block. What a block
is without one follows from its language; `page_run` and `test_blocks` have the meanings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

MARKS = ("before", "after", "exits", "file", "keys of", "run by", "not run")
_COMMENTS = r"(?P<marks>(?:^<!-- (?:" + "|".join(MARKS) + r"):.*?-->\n\n?)*)"
_BLOCK = re.compile(
    _COMMENTS + r"^(?P<indent> *)```(?P<info>[^`\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
_UNSEEN = re.compile(r"(?:[\s>*+-]|\d+[.)])*(?:```|~~~|<pre\b)")
_MARK = re.compile(r"^<!-- (" + "|".join(MARKS) + r"): *(.*?) *-->$", re.MULTILINE | re.DOTALL)
_GENERATED = re.compile(r"^<!-- generated: .*?^<!-- end -->$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, and what the comments before it say."""

    language: str
    text: str
    marks: dict[str, str]
    line: int
    span: tuple[int, int]
    """Where the text begins and ends in the page."""
    is_generated: bool
    """Whether tests write it anew from the code: then nothing else looks at it."""

    @property
    def is_spec(self) -> bool:
        return self.language == "yaml" and re.match(r"msnn: 1\b", self.text) is not None

    @property
    def file(self) -> str | None:
        """The file that it is: by its title or a comment, of a spec by the model's name."""
        named = self.marks.get("file")
        if named is None and self.is_spec:
            found = re.search(r"^name: (\w+)", self.text, re.MULTILINE)
            named = f"{found[1]}.msnn.yaml" if found else None
        return named


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    made = [found.span() for found in _GENERATED.finditer(text)]
    return [_block(text, found, made) for found in _BLOCK.finditer(text)]


def without_code(page: Path) -> str:
    """A page with empty lines in place of its blocks and of what is said of them."""
    return _BLOCK.sub(lambda found: "\n" * found[0].count("\n"), page.read_text(encoding="utf-8"))


def indented_code(page: Path) -> list[int]:
    """Lines of code without a fence, which nobody can mark: four blanks after an empty line."""
    lines = without_code(page).split("\n")
    return [
        n + 1
        for n, line in enumerate(lines)
        if line.startswith("    ") and not lines[n - 1].strip() and not _in_list(lines, n)
    ]


def unseen_code(page: Path) -> list[int]:
    """Lines of code that `blocks_of` does not see: behind other fences, in quotes, in HTML."""
    return [n for n, line in enumerate(without_code(page).split("\n"), 1) if _UNSEEN.match(line)]


def _in_list(lines: list[str], n: int) -> bool:
    """Whether the nearest line above that is not indented is an item of a list."""
    above = (line for line in reversed(lines[:n]) if line.strip() and not line.startswith(" "))
    return re.match(r"(?:[-*]|\d+\.) ", next(above, "")) is not None


def _block(text: str, found: re.Match[str], made: list[tuple[int, int]]) -> Block:
    language, _, rest = found["info"].strip().partition(" ")
    marks: dict[str, str] = dict(_MARK.findall(found["marks"]))
    title = re.search(r'title="([^"]+)"', rest)
    if title:
        marks["file"] = title[1]
    return Block(
        language=language,
        text=found["text"],
        marks=marks,
        line=text.count("\n", 0, found.start("info")) + 1,
        span=found.span("text"),
        is_generated=any(start < found.start() < end for start, end in made),
    )
