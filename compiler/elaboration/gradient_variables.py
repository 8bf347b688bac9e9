"""Finds the equations and outputs that gradients are taken with respect to, before lowering."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from compiler.linking.link import Linked
from spec_schema.expressions.tree import Call, Expression, LanguageName, Name
from spec_schema.sections.references import calls_in
from spec_schema.sections.spec import Spec


def gradient_variables(spec: Spec) -> frozenset[str]:
    """The names of equations and outputs that stand after the comma of a `grad(y, x)`.

    A function may take x from its call, which may stand in a function too: `f(e)` with the formula
    `grad(a**2, a)` has the variable e. Every formula is read, those of unused functions too.
    """
    values = spec.equations.keys() | spec.outputs.keys()
    model = (spec.states, spec.equations, spec.outputs, spec.layers, spec.losses)
    waiting = [(call, _NOTHING) for call in calls_in(model)]
    for function in spec.functions.values():
        # by itself an argument stands for no entry, and none is named ""
        unknown = {argument.value: "" for argument in function.args}
        waiting += [(call, unknown) for call in calls_in(function)]
    found: set[str] = set()
    entered: set[tuple[str, tuple[str, ...]]] = set()
    while waiting:
        call, arguments = waiting.pop()
        name = call.function.name if isinstance(call.function, Name) else ""
        function = None if isinstance(call.function, LanguageName) else spec.functions.get(name)
        if function is None:
            if name == "grad" and name not in spec.layers and len(call.arguments) == 2:
                found.add(_variable(call.arguments[1], arguments))
            continue
        wanted = [argument.value for argument in function.args]
        given = {key: _variable(value, arguments) for key, value in _given(call, wanted)}
        key = name, tuple(given.get(argument, "") for argument in wanted)
        # a function that calls itself, which is reported later, would be entered for ever
        if key not in entered:
            entered.add(key)
            waiting += [(inner, given) for inner in calls_in(function)]
    return frozenset(found & values)


def implicit_equations(linked: Linked) -> frozenset[str]:
    """The equations in which integrators are implicit: `linear_implicit: {of: NAME}`."""
    found: set[str] = set()
    for owner, integrator in linked.integrators.items():
        method = integrator.linear_implicit if integrator is not None else None
        if method is not None and method.of is not None:
            found.add(f"{owner}.{method.of.value}" if owner else method.of.value)
    return frozenset(found)


_NOTHING: Mapping[str, str] = {}


def _given(call: Call, wanted: list[str]) -> Iterator[tuple[str, Expression]]:
    yield from zip(wanted, call.arguments, strict=False)
    yield from ((keyword.name, keyword.value) for keyword in call.keywords)


def _variable(expression: Expression, arguments: Mapping[str, str]) -> str:
    """The name that a bare name stands for, "" for any other expression."""
    if not isinstance(expression, Name):
        return ""
    return arguments.get(expression.name, expression.name)
