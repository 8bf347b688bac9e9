"""Comments on generated statements with the line and formula of the spec."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

from backends.c_language.scope import BlockScope
from compiler.ir.program import Formula, Graph, Node
from spec_schema.diagnostics.source import Span

_LONGEST_FORMULA = 120
"""Maximum number of characters of a formula in a comment."""


_LEFT = re.compile(r"(der|next)\((.*)\)")
"""`der(x)` becomes `x_der` in a name."""


class SpecNotes:
    """Writes comments above generated statements: line and formula of the spec from which they
    come. A node inside a formula has no name of its own and uses that of the formula. Without
    `formulas` it uses the named node whose place in the spec contains it, or the only one on its
    line.
    """

    def __init__(self, graph: Graph, formulas: Sequence[Formula] = ()) -> None:
        self._named: dict[tuple[str, int], dict[Span, str]] = {}
        for node in graph.nodes:
            if node.span is not None and node.label is not None:
                line = self._named.setdefault((node.span.file, node.span.line), {})
                # the first node of a place: integrator substeps repeat an equation
                line.setdefault(node.span, node.label)
        self._formulas: dict[tuple[str, int], list[Formula]] = {}
        for formula in formulas:
            span = formula.span
            # a formula over several lines is registered for each of them
            for line in range(span.line, span.end_line + 1):
                self._formulas.setdefault((span.file, line), []).append(formula)
        self._shown: set[Formula] = set()

    def write(self, node: Node, scope: BlockScope) -> None:
        """Adds a comment about the node to the block, unless the comment before was about the same
        equation. The formula is shown only the first time, since a step evaluates some equations
        many times. A node without place in the spec gets no comment.
        """
        if node.span is None:
            return
        formula = self._formula(node.span)
        if formula in self._shown:
            formula = None
        said, place = self._what(node, formula), span_text(node.span)
        about = f"{self._equation(node)} {place}"
        if scope.note(f"spec: {said} ({place})" if said else f"spec: {place}", about) and formula:
            self._shown.add(formula)

    def part_name(self, node: Node, kind: str) -> str:
        """A name for a value inside an equation: `drag_sum` for kind `sum` in the equation of
        `drag`, or the kind alone if the equation is unknown.
        """
        equation = _LEFT.sub(r"\2_\1", self._equation(node) or "")
        return f"{equation}_{kind}" if equation else kind

    def _what(self, node: Node, formula: Formula | None) -> str:
        """The text about a node in a comment: `travel [m] = w - z`, or `dz_1 [m/s], der(dz) = load
        / body`; without a formula the name of its equation, or nothing.
        """
        name = self._equation(node) or ""
        if formula is None:
            return name
        right = formula.right
        if len(right) > _LONGEST_FORMULA:
            right = f"{right[:_LONGEST_FORMULA]}..."
        own = node.label is not None and node.type.unit is not None
        unit = f" [{node.type.unit.text}]" if own and node.type.unit is not None else ""
        if formula.left == name:
            return f"{name}{unit} = {right}"
        return f"{name}{unit}, {formula.left} = {right}" if name else f"{formula.left} = {right}"

    def _formula(self, span: Span) -> Formula | None:
        """The first formula whose text in the spec contains the start of the span; None if there is
        none.
        """
        formulas = self._formulas.get((span.file, span.line), ())
        return next((formula for formula in formulas if _holds(formula.span, span)), None)

    def _equation(self, node: Node) -> str | None:
        if node.label is not None or node.span is None:
            return node.label
        formula = self._formula(node.span)
        if formula is not None:
            return formula.left
        named = self._named.get((node.span.file, node.span.line), {})
        around = [span for span in named if _holds(span, node.span)]
        if around:
            # places are nested: the innermost one ends first
            return named[min(around, key=lambda span: (span.end_line, span.end_column))]
        return next(iter(named.values())) if len(set(named.values())) == 1 else None


def _holds(whole: Span, part: Span) -> bool:
    """True if `part` starts inside `whole`; both are in one file."""
    begins = (part.line, part.column)
    return (whole.line, whole.column) <= begins < (whole.end_line, whole.end_column)


def span_text(span: Span) -> str:
    """File name and line, `plant.msnn.yaml:31`. Folders are left out, so that the files are the
    same on all machines.
    """
    return f"{PurePath(span.file).name}:{span.line}"
