"""Maps statements of generated C to lines of the spec, using comments."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_NOTE = re.compile(r"/\*\s*spec:\s*((?:(?!\*/).)*?:\d+\)?)\s*\*/", re.DOTALL)
_FOLD = re.compile(r"\s*\n\s*\*?\s*")
"""Matches the break between two lines of one comment."""
_FORMULA = re.compile(r" \[|, | = ")
"""Matches the unit and formula after the name, at the first computation."""
_END = re.compile(r"^\}|^ {4}/\*", re.MULTILINE)
"""Matches the end of a function, or of a block with its own comment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedBlock:
    """Lines `first` … `last` of a C file, and the item of the spec that they compute."""

    file: str
    first: int
    last: int
    name: str
    """The equation, output or state; empty if the line has no name."""
    spec: str
    line: int

    @property
    def place(self) -> str:
        """The place in the spec, such as `plant.msnn.yaml:31`."""
        return f"{self.spec}:{self.line}"

    @property
    def lines(self) -> str:
        """The lines of C, such as `plant.c:65-106`."""
        return f"{self.file}:{self.first}" + (f"-{self.last}" if self.last > self.first else "")


def traced(sources: tuple[Path, ...]) -> tuple[TracedBlock, ...]:
    """The blocks of all files, ordered by line."""
    return tuple(
        block for source in sources for block in _blocks(source.name, source.read_text("utf-8"))
    )


def place_of(blocks: tuple[TracedBlock, ...], file: str, line: int) -> str | None:
    """The place in the spec for a line of C: the last comment before it."""
    before = [block.place for block in blocks if block.file == file and block.first <= line]
    return before[-1] if before else None


def by_spec_line(blocks: tuple[TracedBlock, ...]) -> list[tuple[str, str, str]]:
    """A table of the spec's places, names, and the lines of C that compute them."""
    found: dict[tuple[str, int], list[TracedBlock]] = {}
    for block in blocks:
        found.setdefault((block.spec, block.line), []).append(block)
    return [
        (
            group[0].place,
            ", ".join(dict.fromkeys(block.name for block in group if block.name)),
            ", ".join(block.lines for block in group),
        )
        for _, group in sorted(found.items())
    ]


def _blocks(file: str, text: str) -> list[TracedBlock]:
    notes = list(_NOTE.finditer(text))
    ends = [note.start() for note in notes[1:]] + [len(text)]
    blocks: list[TracedBlock] = []
    for note, end in zip(notes, ends, strict=False):
        said = _FOLD.sub(" ", note.group(1))
        what, place = _what_and_place(said)
        spec, _, line = place.rpartition(":")
        # a block ends before the next note where its function or heading does
        closed = _END.search(text, note.end(), end)
        stop = end if closed is None else closed.start()
        first, last = text.count("\n", 0, note.start()) + 1, text[:stop].rstrip().count("\n") + 1
        name = _FORMULA.split(what)[0]
        blocks.append(
            TracedBlock(file=file, first=first, last=last, name=name, spec=spec, line=int(line))
        )
    return blocks


def _what_and_place(said: str) -> tuple[str, str]:
    """Splits `v_next (plant (1).msnn.yaml:27)` into `v_next` and `plant (1).msnn.yaml:27`.

    A comment with a name or formula ends with its place in parentheses, which may be nested.
    """
    if not said.endswith(")"):
        return "", said
    depth = 0
    # from the end, to the bracket that opens the last one: names of files may have brackets
    for position in range(len(said) - 1, -1, -1):
        depth += (said[position] == ")") - (said[position] == "(")
        if not depth:
            return said[:position].rstrip(), said[position + 1 : -1]
    return "", said.removesuffix(")")
