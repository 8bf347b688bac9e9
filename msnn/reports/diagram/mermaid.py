"""Draws a spec as Mermaid graph of its signals, layers, equations, states and outputs."""

from __future__ import annotations

from msnn.reports.diagram.flow import Kind, Part, parts_of
from spec_schema.sections.spec import Spec

# What encloses the label of each kind.
_SHAPES: dict[Kind, tuple[str, str]] = {
    "inputs": ("([", "])"),
    "targets": ("([", "])"),
    "parameters": ("{{", "}}"),
    "layers": ("[[", "]]"),
    "states": ("[(", ")]"),
    "equations": ("[", "]"),
    "outputs": ("([", "])"),
    "losses": (">", "]"),
}


def mermaid_text(spec: Spec) -> str:
    """A flowchart with an arrow from every name in a formula to the item that it defines.

    A dotted arrow leads from an output to the signal that it predicts.
    """
    found = parts_of(spec)
    # numbers, as names may be words of Mermaid's own (`end`) or Greek
    number = {part.name: f"n{index}" for index, part in enumerate(found.parts)}
    lines = ["flowchart LR"]
    for part in found.parts:
        opening, closing = _SHAPES[part.kind]
        lines.append(f'  {number[part.name]}{opening}"{_label(part)}"{closing}')
    for arrow in found.arrows:
        line = "-. predicts .->" if arrow.predicts else "-->"
        lines.append(f"  {number[arrow.source]} {line} {number[arrow.target]}")
    return "\n".join(lines)


def _label(part: Part) -> str:
    joint = ": " if part.kind == "layers" else " "
    return _escaped(f"{part.name}{joint}{part.about}" if part.about else part.name)


def _escaped(text: str) -> str:
    """Escapes characters with a special meaning in Mermaid or HTML."""
    # what text is safe is listed, not what is not: quotes, brackets and `#` differ by Mermaid's
    # version
    return "".join(c if c.isalnum() or c in " _:." else f"#{ord(c)};" for c in text)
