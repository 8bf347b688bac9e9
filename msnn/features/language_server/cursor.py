"""Finds sections, names and the key at a position from indentation, even in invalid text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from compiler.lowering.context import Kind
from spec_schema.diagnostics.source import SourceText

ITEM = "0"
"""The path step for any item of a list."""

# possessive (`++`, `*+`): a line that does not match fails in one pass, however long it is
_BLOCK = re.compile(
    r"(?P<indent> *+)(?P<dashes>(?:-[ ]++)*+)"
    r"(?:(?P<key>[^\s#:{}\[\],\"'&*!|>%@`-][^:#{}\[\],]*+|\"[^\"]*+\"|'[^']*+'):(?=[ ]|$)"
    r"(?P<rest>.*))?"
)
_FLOW = re.compile(
    r"(?<![\w)\]])(?:\"[^\"]*+(?:\"|$)|'[^']*+(?:'|$))|[{}\[\],]|:(?=[\s{\[\"']|$)|#[^\n]*+"
)
_FURTHEST_FLOW = 60
"""Maximum number of lines in which the enclosing bracket is searched."""


@dataclass(frozen=True)
class Cursor:
    """A position in a spec.

    `path` leads to the mapping that contains a key, or to a value; a step is a key, or ITEM for an
    item of a list. `before` is the text of the key or value before the position. On an empty line
    `is_key` is True, although a value may follow.
    """

    path: tuple[str, ...]
    is_key: bool
    before: str


@dataclass
class _Bracket:
    """An open bracket: a mapping or a list, the key of the current pair, and the index at which the
    text after the last separator begins.
    """

    is_map: bool
    key: str | None = None
    start: int = 0


def cursor_at(source: SourceText, line: int, column: int) -> Cursor:
    """The keys that lead to a position and the text before it; line and column count characters
    from zero. Invalid YAML is allowed.
    """
    text = source.line(line + 1)
    inside = _in_flow(source, line, column)
    if inside is not None:
        return inside
    found = _BLOCK.match(text)
    assert found is not None  # it takes an empty text too
    start = found.end("dashes")
    key = found["key"]
    if key is not None and column > found.end("key"):
        value = text[found.end("key") + 1 : column].lstrip()
        return Cursor((*_parents(source, line, found), _plain(key)), False, _unquoted(value))
    # on an empty line the place of the cursor says how deep one is about to write
    if key is None and not found["dashes"] and not text[start:].strip():
        start = column
    above = _parents(source, line, found, start)
    before = text[start:column] if column > start else ""
    if key is None:
        # a formula over several lines
        scalar = _continued(source, line, start)
        if scalar:
            return Cursor(above, False, before)
    return Cursor(above, True, before)


def _in_flow(source: SourceText, line: int, column: int) -> Cursor | None:
    """The cursor if the position is within `{ }` or `[ ]` that open on this line or at most
    `_FURTHEST_FLOW` lines above; None outside brackets.
    """
    if source.text.startswith("{"):  # JSON, or a text in its manner
        # JSON is all brackets: from its first line on
        lines = [source.line(number + 1) for number in range(line)]
        whole = "\n".join([*lines, source.line(line + 1)[:column]])
        brackets = _open(whole)
        return _within((), brackets, whole) if brackets else None
    for first in range(line, max(-1, line - _FURTHEST_FLOW), -1):
        text = source.line(first + 1)
        found = _BLOCK.match(text)
        assert found is not None
        start = found.start("rest") if found["key"] is not None else found.end("dashes")
        value = text[start:].lstrip()
        if not value.startswith(("{", "[")) or (found["key"] is None and not found["dashes"]):
            continue
        begin = len(text) - len(value)
        # the bracket begins behind the place
        if first == line and begin >= column:
            continue
        rest = [source.line(number + 1) for number in range(first, line + 1)]
        rest[-1] = rest[-1][:column]
        if first < line and not _open(rest[0][begin:]):
            return None  # what is above is closed, and what is further above too
        brackets = _open("\n".join(rest)[begin:])
        # closed before the place
        if not brackets:
            return None
        key = found["key"]
        above = _parents(source, first, found)
        whole = "\n".join(rest)[begin:]
        return _within((*above, _plain(key)) if key is not None else above, brackets, whole)
    return None


def _open(text: str) -> list[_Bracket]:
    """The brackets that are open at the end of `text`, outermost first. Empty once the first
    bracket is closed, with which the text starts.
    """
    brackets: list[_Bracket] = []
    for found in _FLOW.finditer(text):
        match found.group():
            case "{" | "[" as bracket:
                brackets.append(_Bracket(bracket == "{", start=found.end()))
            case "}" | "]":
                if brackets:
                    brackets.pop()
                if not brackets:
                    return []
            # the next item or pair of the innermost bracket
            case "," if brackets:
                brackets[-1].key, brackets[-1].start = None, found.end()
            case ":" if brackets and brackets[-1].is_map and brackets[-1].key is None:
                brackets[-1].key = text[brackets[-1].start : found.start()].strip()
                brackets[-1].start = found.end()
            case _:
                pass
    return brackets


def _within(above: tuple[str, ...], brackets: list[_Bracket], text: str) -> Cursor:
    steps = [(b.key if b.is_map else ITEM) for b in brackets]
    path = (*above, *(_plain(step) for step in steps if step is not None))
    last = brackets[-1]
    return Cursor(path, last.is_map and last.key is None, _unquoted(text[last.start :].lstrip()))


def _parents(
    source: SourceText, line: int, found: re.Match[str], column: int | None = None
) -> tuple[str, ...]:
    """The path to the mapping or list that contains a line: keys and ITEM, outermost first.

    `found` is the match of `_BLOCK` on the line. `column` is the indentation of the text, if it is
    not that of the line's key.
    """
    # what contains a line is indented less: upwards, each key left of the last one is the next
    # parent
    limit = found.end("dashes") if column is None else column
    steps: list[str] = []
    is_item = False
    if found["dashes"] and limit >= found.end("dashes"):
        steps, limit, is_item = _items(found, steps)
    for number in range(line, 0, -1):
        if not limit and not is_item:
            break
        text = source.line(number)
        written = text.lstrip(" ")
        indent = len(text) - len(written)
        # deeper lines, empty ones and comments say nothing of what contains this one
        if indent > limit or not written or written[0] == "#" or (indent == limit and not is_item):
            continue
        above = _BLOCK.match(text)
        assert above is not None
        at = above.end("dashes")
        if above["key"] is not None and (at < limit or (at == limit and is_item and at == indent)):
            steps.append(_plain(above["key"]))
            limit, is_item = at, False
        if above["dashes"] and indent < limit:
            steps, limit, is_item = _items(above, steps)
    return tuple(reversed(steps))


def _items(found: re.Match[str], steps: list[str]) -> tuple[list[str], int, bool]:
    """`steps` with one ITEM for each dash of a line, the indentation of the line, and True since it
    is an item of a list. `steps` begin with the innermost.
    """
    return [*steps, *[ITEM] * found["dashes"].count("-")], len(found["indent"]), True


def _continued(source: SourceText, line: int, column: int) -> bool:
    """True if a line without a key, whose text begins at `column`, continues a value that a less
    indented line above begins.
    """
    for number in range(line, 0, -1):
        text = source.line(number)
        written = text.lstrip(" ")
        if not written or len(text) - len(written) >= column:
            continue
        above = _BLOCK.match(text)
        assert above is not None
        is_parent = above["key"] is not None and above.end("dashes") < column
        value = above["rest"].strip() if is_parent else ""
        # what begins with a bracket is a flow value, found by its brackets
        return bool(value) and value[0] not in "#&{["
    return False


def _plain(key: str) -> str:
    return _unquoted(key.strip()).rstrip("\"'")


def _unquoted(text: str) -> str:
    return text[1:] if text[:1] in {'"', "'"} else text


KINDS = {
    "use": Kind.SUBMODEL,
    "dims": Kind.DIMENSION,
    "inputs": Kind.INPUT,
    "targets": Kind.TARGET,
    "constants": Kind.CONSTANT,
    "parameters": Kind.PARAMETER,
    "layers": Kind.LAYER,
    "functions": Kind.FUNCTION,
    "states": Kind.STATE,
    "equations": Kind.EQUATION,
    "outputs": Kind.OUTPUT,
}
"""Sections that declare names, with their kind."""

# No pattern gives back what it took: a hostile line would take the square of its length.
_KEY = r"([^\s#:{}\[\],\"'&*!|>%@`-][^:#{}\[\],\r\n]*+):(?=[ \r\n]|$)(.*)$"
_SECTION = re.compile(f"^{_KEY}", re.M)
_BELOW = re.compile(f"^( ++){_KEY}", re.M)
_IN_FLOW = re.compile(
    r"([^\s{}\[\],:\"'#]++)(\s*+:(?=[\s{\[]))?|([{\[])|([}\]])|\"[^\"]*+\"|'[^']*+'"
)


@dataclass(frozen=True, slots=True)
class Heading:
    """A key of the text: its line and column from zero, and the last line of its value."""

    name: str
    line: int
    column: int
    last_line: int

    @property
    def end_column(self) -> int:
        """The column where the key ends."""
        return self.column + len(self.name)


@dataclass(frozen=True, slots=True)
class OutlineSection:
    """A section such as `states:`, and the keys directly below it."""

    heading: Heading
    entries: tuple[Heading, ...]

    @property
    def kind(self) -> Kind | None:
        """The kind of names that its keys declare; None for a section that declares none."""
        return KINDS.get(self.heading.name)


def outline(source: SourceText) -> tuple[OutlineSection, ...]:
    """The sections of a text in order, found by indentation; invalid YAML is allowed."""
    found = list(_SECTION.finditer(source.text))
    ends = [*(section.start() for section in found), len(source.text)][1:]
    return tuple(
        OutlineSection(
            _heading(section[1], section.start(1), end, source),
            tuple(_entries(section, end, source)),
        )
        for section, end in zip(found, ends, strict=True)
    )


def _entries(section: re.Match[str], end: int, source: SourceText) -> Iterator[Heading]:
    """The keys of the first indentation below a section, or in its `{ }`. `section` is the match of
    its key, `end` the offset of the next section.
    """
    first = _BELOW.search(source.text, section.end(), end)
    if first is None:
        yield from _headings_in_flow(section, source.position(section.start())[0] - 1)
        return
    # deeper keys are options of entries, not names
    alike = re.compile(f"^{first[1]}{_KEY}", re.M)
    found = list(alike.finditer(source.text, first.start(), end))
    ends = [*(entry.start() for entry in found), end][1:]
    for entry, last in zip(found, ends, strict=True):
        yield _heading(entry[1], entry.start(1), last, source)


def _headings_in_flow(section: re.Match[str], line: int) -> Iterator[Heading]:
    depth = 0
    for found in _IN_FLOW.finditer(section[2]):
        # depth 1 is in the section's own bracket
        depth += bool(found[3]) - bool(found[4])
        if found[2] and depth == 1:
            column = section.start(2) - section.start() + found.start(1)
            yield Heading(found[1], line, column, line)


def _heading(key: str, start: int, end: int, source: SourceText) -> Heading:
    """The heading of a key at the offset `start` of the text, whose value ends before the offset
    `end`.
    """
    line, column = source.position(start)
    # `end` begins the next key: its line, counted from one, less that line and the count
    last = source.position(end)[0] - (2 if end < len(source.text) else 1)
    return Heading(key.rstrip(), line - 1, column - 1, max(line - 1, last))
