"""Stores the source text of formulas, which generated code shows as comments."""

from __future__ import annotations

from compiler.ir.program import Formula
from spec_schema.expressions.text import expression_text
from spec_schema.expressions.tree import Expression
from spec_schema.sections.spec import Spec


def formulas_of(spec: Spec) -> tuple[Formula, ...]:
    """The formulas of all equations, outputs and states of a linked spec, in its order."""
    written: list[tuple[str, Expression]] = []
    for name, state in spec.states.items():
        if state.der is not None:
            written.append((f"der({name})", state.der))
        if state.next is not None:
            written.append((f"next({name})", state.next))
    for section in (spec.equations, spec.outputs):
        written += [(name, entry.expr) for name, entry in section.items()]
    return tuple(Formula(left, expression_text(right), right.span) for left, right in written)
