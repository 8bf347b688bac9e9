"""Explains unknown names, with the intended name if it can be guessed."""

from __future__ import annotations

from compiler.ir.scalars.signatures import SIGNATURES
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.scope import Kind
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.expressions.language import ELSEWHERE, LOSS_FUNCTIONS, NUMBERS
from spec_schema.expressions.names_elsewhere import formula_for, written_here
from spec_schema.expressions.tree import Member, Name
from spec_schema.registry import FUNCTIONS

_CALLABLE = (Kind.LAYER, Kind.FUNCTION)


def unknown_value(context: Context, name: str, span: Span, member: str) -> Diagnostic:
    """The diagnostic of an unknown name, or of the part before the dot of a `member`."""
    if name in SIGNATURES:
        return names.not_a_value(name, "a builtin", span)
    known = (*context.scope, "dt", *NUMBERS)
    repair = written_here(name, member, SIGNATURES) if member else None
    return names.unknown_name(name, span, known, repair=repair, otherwise=formula_for(name))


def unknown_function(context: Context, function: Name, environment: Environment) -> Diagnostic:
    """The diagnostic of a call of an unknown function."""
    name = function.name
    callable = [n for n, declared in context.scope.items() if declared.kind in _CALLABLE]
    losses = LOSS_FUNCTIONS if environment.part is EnvironmentPart.LOSS else ()
    return names.unknown_name(
        name,
        function.span,
        (*callable, *SIGNATURES, *losses, *FUNCTIONS),
        "a layer or function",
        ELSEWHERE.get(name),
        otherwise=formula_for(name),
    )


def unknown_method(context: Context, function: Member) -> Diagnostic:
    """The diagnostic of a call after a dot: `np.tanh(…)`."""
    repair = None
    if function.base not in context.scope:
        repair = written_here(function.base, function.name, SIGNATURES)
    return names.no_member(function.base, function.name, function.span, repair)
