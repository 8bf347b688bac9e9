"""Lowers unused entries, to find their mistakes, and warns about them."""

from __future__ import annotations

from contextlib import suppress

from compiler.elaboration.named_values.found_before import FoundBefore
from compiler.elaboration.named_values.names import Elaboration
from compiler.lowering.context import Context
from compiler.lowering.environment import STEP
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.scope import Kind, owner_of
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Name, Number
from spec_schema.sections.layers.layer import Layer

_EXPECTED_IN_USE = frozenset(
    {Kind.INPUT, Kind.CONSTANT, Kind.PARAMETER, Kind.LAYER, Kind.FUNCTION, Kind.EQUATION}
)


def lower_unused(elaborated: Elaboration) -> None:
    """Lowers unused entries, so that their mistakes are reported.

    For sub-models only equations are lowered; their own files report the rest.
    """
    context = elaborated.context
    for name, entry in context.spec.equations.items():
        with suppress(LoweringFailed):
            elaborated.entries.value(name, entry, STEP, entry.place.key)
    for name, constant in context.spec.constants.items():
        if name not in context.used and not owner_of(name):
            with suppress(LoweringFailed):
                elaborated.constants.value(name, constant)
    _report_parameters(elaborated)
    for name, layer in context.spec.layers.items():
        if name not in context.used and not owner_of(name):
            _report_layer(elaborated, name, layer)
    for name, function in context.spec.functions.items():
        if name not in context.used and not owner_of(name):
            found = _found_by_calling(elaborated, name, len(function.args))
            # the shapes and units of its arguments are unknown
            context.findings.report(*(d for d in found if d.code in _OF_NAMES))
    if context.unread:
        _report_unread(elaborated)


def _report_unread(elaborated: Elaboration) -> None:
    """Reports name errors in arguments that the formula of the called function does not use."""
    apart = elaborated.afresh(FoundBefore())
    for argument in elaborated.context.unread:
        there = argument.environment
        with suppress(LoweringFailed):
            lower(apart.context, argument.expression, there.in_graph_of(there.part))
    # other errors may be caused by the missing buffers of the program
    found = (d for d in _errors_of(apart) if d.code in _OF_NAMES)
    elaborated.context.findings.report(*found)


def _report_parameters(elaborated: Elaboration) -> None:
    """Reports errors in parameters that nothing uses."""
    context = elaborated.context
    unused = {
        name: entry
        for name, entry in context.spec.parameters.items()
        if name not in context.used and not owner_of(name)
    }
    if not unused:
        return
    # the first use declares a parameter: a separate elaboration keeps them out of the program
    apart = elaborated.afresh(FoundBefore())
    for name, entry in unused.items():
        with suppress(LoweringFailed):
            apart.arrays.parameter(name, entry)
    context.findings.report(*_errors_of(apart))


# findings at this place concern the artificial call, not the spec
_NOWHERE = Span(file="", line=0, column=0, end_line=0, end_column=0)
# names, argument counts, misplaced calls: wrong for any arguments
_OF_NAMES = frozenset(
    {"E0301", "E0303", "E0304", "E0305", "E0306", "E0307", "E0319", "E0349", "E0350"}
)
# axes: a call with other arguments may be right, since options can have their dims; only an
# undeclared dimension (E0405) is wrong in any case
_OF_AXES = frozenset({"E0401", "E0402", "E0403", "E0404", "E0406", "E0407", "E0408"})


def _report_layer(elaborated: Elaboration, name: str, entry: Layer) -> None:
    """Reports the errors of a layer that do not depend on its arguments."""
    found = _found_by_calling(elaborated, name, 1)
    if any(d.span == _NOWHERE for d in found):  # such as a table in two dimensions
        found = _found_by_calling(elaborated, name, 2)
    elaborated.context.findings.report(
        *(d for d in found if d.span != _NOWHERE and d.code not in _OF_AXES)
    )


def _found_by_calling(elaborated: Elaboration, name: str, count: int) -> list[Diagnostic]:
    """The errors of a call with zeros, which fit every unit.

    The call is lowered in separate graphs, so that its nodes, arrays and memories do not remain. If
    it reads the past, it is lowered once more with its buffers, to check how they are initialised.
    """
    zeros = tuple(Number(0.0, _NOWHERE) for _ in range(count))
    call = Call(Name(name, _NOWHERE), zeros, (), _NOWHERE)
    attempt = _lowered_alone(elaborated, call, FoundBefore())
    known = attempt.found()
    if known.buffers:
        attempt = _lowered_alone(elaborated, call, known)
        # only for its reports: buffers without initial values
        attempt.histories.states()
    return _errors_of(attempt)


def _errors_of(attempt: Elaboration) -> list[Diagnostic]:
    return [d for d in attempt.context.findings.in_order if d.severity == "error"]


def _lowered_alone(elaborated: Elaboration, call: Call, known: FoundBefore) -> Elaboration:
    attempt = elaborated.afresh(known)
    with suppress(LoweringFailed):
        lower(attempt.context, call, STEP)
    return attempt


def report_unused(context: Context) -> None:
    """Warns about entries that nothing refers to."""
    for name, declared in context.scope.items():
        # entries of sub-models may be unused here
        expected = declared.kind in _EXPECTED_IN_USE and not owner_of(name)
        if expected and name not in context.used:
            place = declared.entry.place.key
            context.findings.report(names.unused_entry(name, declared.kind.value, place))
