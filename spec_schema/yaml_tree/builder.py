"""Builds the tree of nodes from PyYAML's events, without recursion and within fixed budgets."""

import re
from collections.abc import Sequence
from dataclasses import field
from typing import Any, Literal, TypeAlias

import yaml

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import yaml_text as errors
from spec_schema.late_dataclass import dataclass
from spec_schema.names import normalised
from spec_schema.yaml_tree.nodes import (
    Listing,
    Node,
    Positions,
    Scalar,
    Table,
    core_value,
    kind,
    with_key,
)

Style: TypeAlias = Literal["plain", "'", '"', "|", ">"]

_FOLD = re.compile(r"[ \t]*(?:(?:\r\n|\r|\n)[ \t]*)+|[ \t]+")
_BREAK = re.compile(r"\r\n|\r|\n")
_ESCAPED_BREAK = re.compile(r"\\(?:\r\n|\r|\n)[ \t]*(?:(?:\r\n|\r|\n)[ \t]*)*")
_ESCAPE_LENGTHS = {"x": 4, "u": 6, "U": 10}
_LINE = re.compile(r"(?P<indent> *)(?P<content>[^\r\n]*)(?P<end>\r\n|\r|\n|$)")


def scalar_offsets(text: str, start: int, end: int, style: Style, value: str) -> Sequence[int]:
    """The offset in the file of each character of a scalar's `value`, and of its end.

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
    """The number of blanks that YAML removed before each line of a block scalar."""
    content = value.lstrip("\n")
    kept = len(content) - len(content.lstrip(" "))
    first = next((line for line in lines if line["content"]), None)
    return len(first["indent"]) - kept if first is not None else 0


DEEPEST = 64
MOST_VALUES = 50_000

_TAB_OR_COMMENT = re.compile(r"\t|#[^\r\n]*")
_COMMA = re.compile(r"\s*,")
_INTEGER = re.compile(r"[+-]?\d+")
_ANCHOR = re.compile(r"&\S*\s*")
_STYLES: dict[str | None, Style] = {"'": "'", '"': '"', "|": "|", ">": ">"}


class StoppedError(Exception):
    """Reading the file stops; the reason has been reported."""


@dataclass(kw_only=True)
class _Open:
    """A list or mapping whose end has not been read yet."""

    start: int
    is_table: bool
    is_flow: bool
    anchor: str | None
    items: list[Node] = field(default_factory=list[Node])
    entries: dict[str, Node] = field(default_factory=dict[str, Node])
    keys: dict[str, Span] = field(default_factory=dict[str, Span])
    key: Scalar | None = None
    expects_value: bool = False
    is_split: bool = False
    size: int = 1


class TreeBuilder:
    """Builds the tree of a YAML document from the events of a parser; `root` is the result.

    `text` is that of the source, character for character, as the parser saw it.
    """

    def __init__(self, source: SourceText, text: str, findings: Findings) -> None:
        self.root: Node | None = None
        self._source = source
        self._text = text
        self._read = 0
        self._findings = findings
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[Node, int]] = {}
        self._documents = 0

    def take(self, event: Any) -> None:
        """Adds one event of the parser; StoppedError if the file is too large or too deep."""
        # indices count characters of the text
        start, end = event.start_mark.index, event.end_mark.index
        self._check_tabs(start)
        if isinstance(event, yaml.ScalarEvent) and end == start:
            # The parsers place nothing differently: behind the token before it, or before the next.
            start = end = min(self._read, start)
        self._read = max(self._read, end if isinstance(event, yaml.NodeEvent) else start)
        self._check_tag(event, start)
        match event:
            case yaml.DocumentStartEvent():
                self._documents += 1
                if self._documents > 1:
                    self._stop(errors.second_document(self._source.span(start, start + 3)))
            case yaml.ScalarEvent():
                self._add(self._scalar(event, start, end), 1, event.anchor)
            case yaml.AliasEvent():
                self._alias(event.anchor, start, end)
            case yaml.CollectionStartEvent():
                is_table = isinstance(event, yaml.MappingStartEvent)
                self._open.append(
                    _Open(
                        start=start,
                        is_table=is_table,
                        is_flow=bool(event.flow_style),
                        anchor=event.anchor,
                    )
                )
                if len(self._open) > DEEPEST:
                    self._stop(errors.too_deep(DEEPEST, self._source.span(start, start + 1)))
            case yaml.CollectionEndEvent():
                self._close(end)
            case _:
                pass

    def _check_tabs(self, start: int) -> None:
        """Stops at a tab between tokens, which PyYAML's two parsers treat differently."""
        for found in _TAB_OR_COMMENT.finditer(self._text, self._read, max(start, self._read)):
            if found.group() == "\t":
                self._stop(errors.tab(self._source.span(found.start(), found.end())))

    def _check_tag(self, event: Any, start: int) -> None:
        tag = getattr(event, "tag", None)
        if tag is not None:
            written = self._text[start:].split(maxsplit=1)[0]
            span = self._source.span(start, start + len(written))
            self._findings.report(errors.tagged(written, span))

    def _scalar(self, event: Any, start: int, end: int) -> Scalar:
        text = self._text
        if event.anchor:
            anchor = _ANCHOR.match(text, start, end)
            start = anchor.end() if anchor else start
        style = _STYLES.get(event.style, "plain")
        if style == "plain" and "\t" in text[start:end]:
            tab = text.index("\t", start)
            self._stop(errors.tab(self._source.span(tab, tab + 1)))
        value: str = event.value
        offsets = scalar_offsets(text, start, end, style, value)
        # PyYAML counts the blank lines below a block scalar, which nobody wants underlined.
        end = max(start, start + len(text[start:end].rstrip()))
        positions = Positions(self._source, offsets)
        meaning = core_value(value) if style == "plain" else value
        return Scalar(
            text=value,
            value=meaning,
            quoted=style != "plain",
            positions=positions,
            span=self._source.span(start, end),
        )

    def _alias(self, name: str, start: int, end: int) -> None:
        span = self._source.span(start, end)
        # an alias within what its anchor names would make an endless tree
        if any(frame.anchor == name for frame in self._open):
            self._stop(errors.own_alias(name, span))
        if name not in self._anchors:
            self._stop(errors.stray_alias(f"*{name}", span))
        node, size = self._anchors[name]
        self._add(node, size, None, span)

    def _add(self, node: Node, size: int, anchor: str | None, place: Span | None = None) -> None:
        """Adds a finished node to the list or mapping around it; `place` is that of its alias, if
        it is one.
        """
        place = place or node.span
        if anchor is not None:
            self._anchors[anchor] = (node, size)
        if not self._open:
            self.root = node
            return
        frame = self._open[-1]
        frame.size += size
        # an alias counts with all that it stands for, which bounds nested ones (“billion laughs”)
        if frame.size > MOST_VALUES:
            self._stop(errors.too_many_values(MOST_VALUES, place))
        if frame.is_flow and isinstance(node, Scalar) and not node.quoted:
            self._check_split(frame, node)
        if not frame.is_table:
            frame.items.append(node)
        elif frame.expects_value:
            self._entry(frame, node)
        else:
            frame.key = self._key(node, place)
            frame.expects_value = True

    def _check_split(self, frame: _Open, node: Scalar) -> None:
        """Reports an unquoted value that a comma within its parentheses has split."""
        is_open = node.text.count("(") > node.text.count(")")
        if is_open and not frame.is_split and _COMMA.match(self._text, self._read):
            frame.is_split = True
            self._findings.report(errors.comma_splits(node.text, node.span))

    def _key(self, node: Node, place: Span) -> Scalar | None:
        if not isinstance(node, Scalar) or node.text == "" or not node.text.isprintable():
            found = kind(node) if not isinstance(node, Scalar) or node.text == "" else "another"
            self._findings.report(errors.key_is_not_text(found, place))
            return None
        if node.text == "<<" and not node.quoted:
            self._findings.report(errors.merge_key(place))
            return None
        return node

    def _entry(self, frame: _Open, node: Node) -> None:
        frame.expects_value = False
        key = frame.key
        # the rest of a value that a comma has split is no key: its fault is reported already
        if key is None or (frame.is_split and self._is_lone(key, node)):
            return
        name = normalised(key.text)
        if frame.is_flow and self._is_lone(key, node):
            self._findings.report(self._lone(frame, key, name))
        elif name in frame.entries:
            self._findings.report(errors.duplicate_key(name, key.span, frame.keys[name]))
        else:
            frame.entries[name] = with_key(node, key.span)
            frame.keys[name] = key.span

    def _lone(self, frame: _Open, key: Scalar, name: str) -> Diagnostic:
        """The diagnostic for a key without value; digits after a number are probably its
        decimals.
        """
        before = next(reversed(frame.entries.values()), None)
        if isinstance(before, Scalar) and not before.quoted and key.text.isdecimal():
            one, two = before.span, key.span
            # end columns are those after the last character; one more is the comma
            touches = (one.end_line, one.end_column + 1) == (two.line, two.column)
            if touches and _INTEGER.fullmatch(before.text):
                return errors.decimal_comma(f"{before.text},{key.text}", one.to(two))
        return errors.key_without_value(name, key.span)

    def _is_lone(self, key: Scalar, node: Node) -> bool:
        """True if `key` is between commas without a colon."""
        if not isinstance(node, Scalar) or not node.is_empty:
            return False
        line, column = key.span.end_line, key.span.end_column
        return not self._source.line(line)[column - 1 :].lstrip().startswith(":")

    def _close(self, end: int) -> None:
        frame = self._open.pop()
        span = self._source.span(frame.start, end)
        last = [*frame.items, *frame.entries.values()][-1:]
        if not frame.is_flow and last:
            # PyYAML ends a block where the next thing starts, maybe lines below.
            span = self._source.span(frame.start, frame.start).to(last[0].span)
        node: Node = (
            Table(frame.entries, frame.keys, span)
            if frame.is_table
            else Listing(tuple(frame.items), span)
        )
        self._add(node, frame.size, frame.anchor)

    def _stop(self, diagnostic: Diagnostic) -> None:
        self._findings.report(diagnostic)
        raise StoppedError
