"""Reads untrusted XML into a tree of elements with source positions.

It reads nothing outside the text and expands no entities: a document type, which could define
entities, is an error. The tree is at most as large as the text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from msnn.features.robots import errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span

DEEPEST = 64
_LONGEST_PLACE = 200
"""Maximum number of underlined characters of a tag."""


@dataclass(frozen=True, slots=True)
class XmlElement:
    """A tag with its attributes, child elements, text and the position of its first line."""

    tag: str
    attributes: Mapping[str, str]
    span: Span
    children: list[XmlElement] = field(default_factory=list["XmlElement"])
    texts: list[str] = field(default_factory=list[str])

    @property
    def text(self) -> str:
        """The text of the element outside its child elements."""
        return "".join(self.texts)

    def all(self, tag: str) -> Iterator[XmlElement]:
        """The child elements with this tag."""
        return (child for child in self.children if child.tag == tag)


class _Refused(Exception):  # noqa: N818  (a fact about a text, no fault of ours)
    """Ends the parsing of a text after its error was reported."""


def read_xml(source: SourceText, findings: Findings) -> XmlElement | None:
    """The root element of a text; None after reporting an error."""
    text = source.text
    content = text.encode()
    stack: list[XmlElement] = []
    roots: list[XmlElement] = []
    parser = expat.ParserCreate("utf-8")

    reached = 0, 0  # bytes and characters: places are asked for from the first to the last

    def offset() -> int:
        nonlocal reached
        # expat counts bytes; decoding on from the last place makes all of them cost one pass
        index = max(parser.CurrentByteIndex, reached[0])
        reached = index, reached[1] + len(content[reached[0] : index].decode(errors="ignore"))
        return reached[1]

    def place() -> Span:
        start = offset()
        line = text[start : start + _LONGEST_PLACE].split("\n", 1)[0]
        return source.span(start, start + (line.find(">") + 1 or len(line)))

    def opened(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag, attributes, place())
        if len(stack) >= DEEPEST:
            findings.report(errors.not_urdf(f"elements in {DEEPEST} others", element.span, None))
            raise _Refused
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def closed(tag: str) -> None:
        del tag
        stack.pop()

    def written(text: str) -> None:
        stack[-1].texts.append(text)

    def refuse(*facts: object) -> None:
        del facts
        findings.report(errors.document_type(place()))
        raise _Refused

    parser.StartElementHandler = opened
    parser.EndElementHandler = closed
    parser.CharacterDataHandler = written
    # an entity can be declared in a document type alone: without one no text grows (billion laughs)
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except _Refused:
        return None
    except expat.ExpatError as error:
        at = min(offset(), len(text))
        findings.report(errors.not_xml(expat.ErrorString(error.code), source.span(at, at)))
        return None
    return roots[0]
