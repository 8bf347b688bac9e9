"""Formats a spec canonically, with its comments, for `msnn fmt`."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.reading.reader import read_one_spec
from spec_schema.sections.spec import Spec
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree
from spec_schema.yaml_tree.writer import quoted

_QUOTABLE = re.compile(r'quote it: "(.*)"', re.DOTALL)
_MOST_QUOTES = 1000
# No text of a spec holds this character: the reader refuses it.
_INSIDE = "\0"
_MARKER = re.compile(r"^(---|\.\.\.|%)", re.MULTILINE)


def format_spec(path: str, text: str) -> str:
    """The text of a spec in canonical layout, with the same meaning.

    Sections are in the order of the grammar, with a blank line around those of several lines.
    Blanks at line ends and needless blank lines are removed. Values that YAML would misread within
    { } or [ ] are quoted. The content of a section stays as it was written. Raises SpecError for a
    spec that has errors.
    """
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    if not path.endswith(".json"):
        text = _quoted_where_needed(path, text)
    # raises for a spec with errors: what nobody can read is not to be moved about
    read_one_spec(path, text)
    before = _meaning(path, text)
    if path.endswith(".json"):
        return _json(text)
    # whatever a layout overlooks, such as an alias above its anchor, shows in another tree: the
    # text then keeps its order, or stays as it is
    for layout in (_in_order, _tidied):
        formatted = layout(path, text)
        if _meaning(path, formatted) == before:
            return formatted
    return text


def _quoted_where_needed(path: str, text: str) -> str:
    """The text with quotes around values that could not be read without them."""
    for _ in range(_MOST_QUOTES):
        # read anew after each repair, which moves the places of all that stands behind it
        findings = Findings()
        read_tree(SourceText(path, text), findings)
        repaired = next((new for d in findings.in_order if (new := _repaired(text, d))), None)
        if repaired is None:
            return text
        text = repaired
    return text


def _repaired(text: str, diagnostic: Diagnostic) -> str | None:
    """The text after the only unambiguous repair; None if there is none."""
    if diagnostic.span is None or diagnostic.code not in ("E0103", "E0104", "E0117"):
        return None
    lines = text.split("\n")
    start = sum(len(line) + 1 for line in lines[: diagnostic.span.line - 1])
    start += diagnostic.span.column - 1
    named = _QUOTABLE.fullmatch(diagnostic.help or "")
    value = named[1] if named else _call_at(text, start)
    # quotes in quotes and values of several lines are left to people
    if not value or not text.startswith(value, start) or '"' in value or "\n" in value:
        return None
    return text[:start] + quoted(value) + text[start + len(value) :]


def _call_at(text: str, start: int) -> str:
    """The complete value that starts here, if commas in parentheses have split it."""
    depth = 0
    for end in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[end], 0)
        if depth < 0 or text[end] == "\n" or (depth == 0 and text[end] in ",]}"):
            return text[start:end].rstrip()
    return ""


def _json(text: str) -> str:
    values = json.loads(text)
    order = {key: index for index, key in enumerate(Spec.known_keys())}
    values = dict(sorted(values.items(), key=lambda item: order.get(item[0], len(order))))
    return json.dumps(values, ensure_ascii=False, indent=2) + "\n"


@dataclass
class _Section:
    """The lines of one top-level key, with the comments directly above it."""

    key: str
    lines: list[str] = field(default_factory=list[str])
    is_apart: bool = False
    """True if a blank line precedes it."""


def _in_order(path: str, text: str) -> str:
    """The sections in the order of the grammar; text above the first stays at the top."""
    root = _root(path, text)
    first = min(root.keys.values(), default=None)
    # documents, directives and keys inside { } have no lines of their own that could move
    if _MARKER.search(text) or first is None or any(k.column > 1 for k in root.keys.values()):
        return _tidied(path, text)
    header, sections = _sections(_lines(root, text), root)
    order = {key: index for index, key in enumerate(Spec.known_keys())}
    sections.sort(key=lambda section: order.get(section.key, len(order)))
    written = [*header]
    for index, section in enumerate(sections):
        before = sections[index - 1].lines if index else header
        wide = index > 0 and (len(section.lines) > 1 or len(before) > 1)
        if written and (wide or section.is_apart):
            written.append("")
        written += section.lines
    return _joined(written)


def _sections(lines: list[str], root: Table) -> tuple[list[str], list[_Section]]:
    keys = sorted(root.keys.items(), key=lambda item: item[1])
    starts: list[int] = []
    for index, (_, span) in enumerate(keys):
        start = span.line - 1
        above = keys[index - 1][1].line if index else start
        # comments at the margin right above a key are about it, and move with it
        while start > above and lines[start - 1].startswith("#"):
            start -= 1
        starts.append(start)
    ends = [*starts[1:], len(lines)]
    sections: list[_Section] = []
    for (key, _), start, end in zip(keys, starts, ends, strict=True):
        part = lines[start:end]
        while part and not part[-1].strip():
            part.pop()
        sections.append(_Section(key, part, start > 0 and not lines[start - 1].strip()))
    header = lines[: starts[0]]
    while header and not header[-1].strip():
        header.pop()
    return header, sections


def _tidied(path: str, text: str) -> str:
    return _joined(_lines(_root(path, text), text))


def _lines(root: Node, text: str) -> list[str]:
    """The lines without trailing blanks, except within multi-line texts."""
    inside = set(_lines_of_texts(root))
    lines = enumerate(text.split("\n"), 1)
    return [_INSIDE + line if number in inside else line.rstrip() for number, line in lines]


def _joined(lines: Sequence[str]) -> str:
    return "\n".join(_without_needless(lines)).replace(_INSIDE, "") + "\n"


def _without_needless(lines: Sequence[str]) -> list[str]:
    """At most one blank line in sequence, and none at the ends."""
    kept: list[str] = []
    for line in lines:
        if line or (kept and kept[-1]):
            kept.append(line)
    while kept and not kept[-1]:
        kept.pop()
    return kept


def _lines_of_texts(node: Node) -> Iterator[int]:
    match node:
        case Scalar(span=span):
            # not the first line, which has its key: its end may be tidied
            yield from range(span.line + 1, span.end_line + 1)
        case Listing(items=items):
            for item in items:
                yield from _lines_of_texts(item)
        case Table(entries=entries):
            for item in entries.values():
                yield from _lines_of_texts(item)


def _root(path: str, text: str) -> Table:
    findings = Findings()
    root = read_tree(SourceText(path, text), findings)
    findings.raise_errors()
    assert isinstance(root, Table)
    return root


def _meaning(path: str, text: str) -> Any:
    """The content of a spec without places and order of sections, to compare two texts."""
    try:
        root = _root(path, text)
    except SpecError:
        return None
    return {key: _values(node) for key, node in root.entries.items()}


def _values(node: Node) -> Any:
    match node:
        case Scalar(text=text, value=value):
            # by text and by meaning: `010` and `10` must not pass for each other, nor 1 for True
            return (text, repr(value))
        case Listing(items=items):
            return [_values(item) for item in items]
        case Table(entries=entries):
            return [(key, _values(item)) for key, item in entries.items()]
