"""Maps each character of a YAML scalar's value to its place in the file."""

import re
from collections.abc import Sequence
from typing import Literal, TypeAlias

Style: TypeAlias = Literal["plain", "'", '"', "|", ">"]

_FOLD = re.compile(r"[ \t]*(?:(?:\r\n|\r|\n)[ \t]*)+|[ \t]+")
_BREAK = re.compile(r"\r\n|\r|\n")
_ESCAPED_BREAK = re.compile(r"\\(?:\r\n|\r|\n)[ \t]*(?:(?:\r\n|\r|\n)[ \t]*)*")
_ESCAPE_LENGTHS = {"x": 4, "u": 6, "U": 10}
_LINE = re.compile(r"(?P<indent> *)(?P<content>[^\r\n]*)(?P<end>\r\n|\r|\n|$)")


def scalar_offsets(text: str, start: int, end: int, style: Style, value: str) -> Sequence[int]:
    """One file offset for each character of `value`, and one for its end.

    `text[start:end]` is the scalar as written, with its quotes or block indicator.
    """
    quoted = style in {"'", '"'}
    first, last = (start + 1, end - 1) if quoted else (start, end)
    # most scalars: nothing escaped, nothing folded
    if text[first:last] == value:
        return range(first, last + 1)
    if style in {"|", ">"}:
        offsets = _block_offsets(text, start, end, value)
    else:
        offsets = _flow_offsets(text, first, last, style, value)
    if offsets is None:
        # A form this module does not know: every character stands for the whole scalar.
        return [start] * len(value) + [end]
    return offsets


def _flow_offsets(text: str, start: int, end: int, style: Style, value: str) -> list[int] | None:
    characters: list[str] = []
    offsets: list[int] = []
    position = start
    while position < end:
        fold = _FOLD.match(text, position, end)
        made, length = text[position], 1
        if fold is not None:
            made, length = _folded(fold.group()), len(fold.group())
        elif style == "'" and made == "'":
            length = 2
        elif style == '"' and made == "\\":
            joined = _ESCAPED_BREAK.match(text, position, end)
            if joined is not None:
                # an escaped break vanishes, each blank line after it is a line feed
                made = "\n" * (len(_BREAK.findall(joined.group())) - 1)
                length = len(joined.group())
            else:
                length = _ESCAPE_LENGTHS.get(text[position + 1], 2)
                # what an escape means is what the value has there
                made = value[len(characters) : len(characters) + 1]
        characters.extend(made)
        # blanks that were not folded keep a place each; of what was, all characters have the first
        blanks_as_written = fold is not None and len(made) == length
        offsets.extend(position + (index if blanks_as_written else 0) for index in range(len(made)))
        position += length
    # a form read wrongly shows here, and is then not used
    return [*offsets, end] if "".join(characters) == value else None


def _folded(blanks: str) -> str:
    """Folds a run of blanks and line breaks: one break to a blank, n breaks to n-1 line feeds."""
    breaks = len(_BREAK.findall(blanks))
    if breaks == 0:
        return blanks
    return " " if breaks == 1 else "\n" * (breaks - 1)


def _block_offsets(text: str, start: int, end: int, value: str) -> list[int] | None:
    header = _BREAK.search(text, start, end)
    if header is None:
        return [end] if value == "" else None
    lines = [line for line in _LINE.finditer(text, header.end(), end) if line.group()]
    offsets: list[int] = []
    indent = _indent(lines, value)
    for line in lines:
        content = line.start() + min(indent, len(line["indent"]))
        written = text[content : line.end("content")]
        done = len(offsets)
        # the same check for each line of a block
        if not value.startswith(written, done):
            return None
        offsets.extend(range(content, content + len(written)))
        # Between lines `|` keeps line feeds and `>` has a blank, or as many line feeds as it likes.
        done = len(offsets)
        joint = 1 if value[done : done + 1] in {" ", "\n"} else 0
        if written or value[done : done + 1] == "\n":
            offsets.extend([line.start("end")] * joint)
    if len(offsets) != len(value):
        return None
    return [*offsets, offsets[-1] + 1 if offsets else end]


def _indent(lines: list[re.Match[str]], value: str) -> int:
    """The indentation that YAML removed: that of the first line, less what is left of it."""
    content = value.lstrip("\n")
    kept = len(content) - len(content.lstrip(" "))
    first = next((line for line in lines if line["content"]), None)
    return len(first["indent"]) - kept if first is not None else 0
