"""Says of generated statements which line of the spec they come from."""

from __future__ import annotations

from pathlib import PurePath

from backends.c_language.scope import Scope
from compiler.ir.program import Graph, Node
from spec_schema.diagnostics.source import Span


class SpecNotes:
    """Comments and names for the statements of one graph.

    A node inside an equation has no name of its own: it goes by that of the equation on its line.
    """

    def __init__(self, graph: Graph) -> None:
        self._names: dict[tuple[str, int], str] = {}
        for node in graph.nodes:
            if node.span is not None and node.label is not None:
                self._names.setdefault((node.span.file, node.span.line), node.label)

    def write(self, node: Node, scope: Scope) -> None:
        """Puts the place of the node before the next statement of the block."""
        if node.span is not None:
            name = self._equation(node)
            place = span_text(node.span)
            scope.note(f"spec: {name} ({place})" if name else f"spec: {place}")

    def part_name(self, node: Node, kind: str) -> str:
        """A name for a value inside an equation: `drag_sum`, or `sum` where nothing is known."""
        equation = self._equation(node)
        return f"{equation}_{kind}" if equation else kind

    def _equation(self, node: Node) -> str | None:
        if node.label is not None or node.span is None:
            return node.label
        return self._names.get((node.span.file, node.span.line))


def span_text(span: Span) -> str:
    """`plant.msnn.yaml:31`; folders are left out, so that two machines write the same file."""
    return f"{PurePath(span.file).name}:{span.line}"
