"""Reads untrusted XML to a tree, and places, directions and numbers from its elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from msnn.features.robots import errors
from msnn.features.robots.urdf.geometry import IDENTITY, ZERO, Matrix, Vector, rotation
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span

LARGEST = 1e30
"""Maximum magnitude in any unit, so that sums of mass times squared length cannot overflow."""


def axis_of(element: XmlElement, what: str, findings: Findings) -> Vector | None:
    """The unit vector of a joint's axis, by default x; None after reporting an error. `what` names
    the joint in messages.
    """
    found = only_element(element, "axis", what, findings)
    if found is None:
        return (1.0, 0.0, 0.0)
    numbers = numbers_of(found, "xyz", 3, what, findings)
    if numbers is None:
        return None
    x, y, z = numbers
    # hypot scales: squares of 1e-200 would vanish
    length = math.hypot(x, y, z)
    if length < 1 / LARGEST:  # which leaves no digits of a direction
        text = found.attributes["xyz"][:40]
        report = errors.malformed_number("xyz", text, "a direction", found.span)
        findings.report(report)
        return None
    return x / length, y / length, z / length


def origin_of(element: XmlElement, what: str, findings: Findings) -> tuple[Matrix, Vector]:
    """Rotation R and offset r (in m) of `<origin xyz rpy>`: a point x of the child is R x + r in
    the frame around it. Identity and 0 without this element, and for values that are reported as
    errors.
    """
    found = only_element(element, "origin", what, findings)
    if found is None:
        return IDENTITY, ZERO
    if "quat_xyzw" in found.attributes:
        findings.report(errors.rotation_as_quaternion(found.span))
    xyz = rpy = ZERO
    if "xyz" in found.attributes:
        x, y, z = numbers_of(found, "xyz", 3, "`<origin>`", findings) or ZERO
        xyz = x, y, z
    if "rpy" in found.attributes:
        roll, pitch, yaw = numbers_of(found, "rpy", 3, "`<origin>`", findings) or ZERO
        rpy = roll, pitch, yaw
    return rotation(*rpy), xyz


def only_element(element: XmlElement, tag: str, what: str, findings: Findings) -> XmlElement | None:
    """The child element with a tag that may occur once, or None. If it is repeated, reports that
    and returns the first.
    """
    found = list(element.all(tag))
    for again in found[1:]:
        said, repair = f"{what} has two `<{tag}>`: which one counts?", "remove one of them"
        findings.report(errors.twice_in_urdf(said, again.span, found[0].span, repair))
    return found[0] if found else None


def attribute_of(element: XmlElement, name: str, what: str, findings: Findings) -> str:
    found = element.attributes.get(name, "")
    if not found:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
    return found


def numbers_of(
    element: XmlElement,
    name: str,
    count: int,
    what: str,
    findings: Findings,
    *,
    largest: float = LARGEST,
) -> tuple[float, ...] | None:
    """The values of the attribute `name`, `count` of them and up to `largest` in magnitude; None
    after reporting an error.
    """
    text = element.attributes.get(name)
    if text is None:
        findings.report(errors.incomplete_element(what, f"`{name}=…`", element.span))
        return None
    try:
        # Python would read 1_0 and digits of any script, which no reader of XML takes for numbers
        foreign = "_" in text or not text.isascii()
        # `nan` and `inf` are read here, and the comparison below refuses them
        numbers = () if foreign else tuple(float(part) for part in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) == count and all(abs(number) <= largest for number in numbers):
        return numbers
    wanted = "a number" if count == 1 else f"{count} numbers"
    if any(largest < abs(number) < math.inf for number in numbers):
        wanted += f" up to {largest:g}"
    findings.report(errors.malformed_number(name, text[:40], wanted, element.span))
    return None


DEEPEST = 64
_LONGEST_PLACE = 200
"""Maximum number of underlined characters of a tag."""


@dataclass(frozen=True, slots=True)
class XmlElement:
    """An XML element: its tag, attributes, child elements and texts, and the place of its opening
    tag.
    """

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
    """The root element of an XML text; None after reporting an error. Document types, which could
    define entities, are refused.
    """
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
