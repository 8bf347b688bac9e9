"""Finds, before lowering, the equations and outputs that gradients are taken with respect to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from compiler.linking.link import Linked
from spec_schema.expressions.tree import Call, Expression, LanguageName, Name
from spec_schema.sections.references import calls_in
from spec_schema.sections.spec import Spec


def gradient_variables(spec: Spec) -> frozenset[str]:
    """Names of equations and outputs that are the variable x of some `grad(y, x)`.

    A function may pass x as an argument: `f(e)` with the formula `grad(a**2, a)` has the variable
    e. All formulas are searched, including those of unused functions.
    """
    values = spec.equations.keys() | spec.outputs.keys()
    model = (spec.states, spec.equations, spec.outputs, spec.layers, spec.losses)
    waiting = [(call, _NOTHING) for call in calls_in(model)]
    for function in spec.functions.values():
        # the arguments of a function without a call are unknown; no entry is named ""
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
        parameters = [argument.value for argument in function.args]
        given = {key: _variable(value, arguments) for key, value in _given(call, parameters)}
        key = name, tuple(given.get(argument, "") for argument in parameters)
        # recursion, which is reported later, would not terminate
        if key not in entered:
            entered.add(key)
            waiting += [(inner, given) for inner in calls_in(function)]
    return frozenset(found & values)


def implicit_equations(linked: Linked) -> frozenset[str]:
    """The equations that an implicit integrator treats implicitly: `linear_implicit: {of:
    NAME}`.
    """
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
    """The name behind a bare name, looked up in the arguments; "" for any other expression."""
    if not isinstance(expression, Name):
        return ""
    return arguments.get(expression.name, expression.name)
