"""Builds XML documents; the same elements give the same bytes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

_NO_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot represent, not even escaped."""

Attributes = Mapping[str, str | None]


def element(name: str, attributes: Attributes) -> Element:
    """An element with the attributes that are not None."""
    return Element(name, _written(attributes))


def child(parent: Element, name: str, attributes: Attributes | None = None) -> Element:
    """Adds such an element as the last child of its parent."""
    return SubElement(parent, name, _written(attributes or {}))


def xml_text(root: Element) -> str:
    """The document; quotes, angle brackets and line ends of any text are escaped."""
    indent(root)
    # line ends in attributes are written as references: XML reads a bare one as a blank
    body = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def number_text(value: float) -> str:
    """The shortest text from which this value is read exactly, also in single precision."""
    number = float(value)
    if not np.isfinite(number):
        return "NaN" if np.isnan(number) else "-INF" if number < 0 else "INF"
    # 1e15 and below are exact integers, and shorter so
    return repr(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _written(attributes: Attributes) -> dict[str, str]:
    known = {name: text for name, text in attributes.items() if text is not None}
    # a character that XML cannot hold, in a doc, must not spoil the whole description
    return {name: _NO_XML.sub("\ufffd", text) for name, text in known.items()}
