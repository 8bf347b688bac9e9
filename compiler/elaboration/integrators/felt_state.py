"""Finds the state whose derivative depends on the equation of `linear_implicit: {of: NAME}`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NoReturn

from compiler.ir.builder import GraphBuilder
from compiler.ir.liveness import needed
from compiler.ir.program import NodeId
from compiler.lowering.context import Context
from compiler.lowering.environment import STEP, Environment
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import states
from spec_schema.expressions.tree import Name
from spec_schema.fields.located import Located
from spec_schema.sections.signals import Equation


def felt_state(
    context: Context,
    owner: str,
    of: Located[str],
    values: Mapping[str, NodeId],
    stage: Environment,
    slope: Callable[[str], NodeId],
) -> tuple[str, NodeId]:
    """Returns the name of the state whose derivative reads the equation, and the equation's value.

    `values` are the states of `owner`; `slope(name)` returns the derivative of a state. Exactly one
    state must both affect the equation and be affected by it; otherwise it reports and raises
    LoweringFailed.
    """
    builder = context.builder(STEP)
    full = f"{owner}.{of.value}" if owner else of.value
    entry = context.names.declared(full, of.span).entry
    if not isinstance(entry, Equation):
        repair = "name the equation of the friction, such as `tau_f`"
        _refuse(context, of, "it is no equation", repair)
    equation = lower(context, Name(full, of.span), stage)
    axes = builder.type(equation).axes
    # both directions: the equation depends on the state, and the derivative on the equation
    found = [
        name
        for name, value in values.items()
        if builder.type(value).axes == axes
        and _depends(builder, equation, value)
        and _depends(builder, slope(name), equation)
    ]
    if len(found) != 1:
        if found:
            problem = f"the derivatives of {' and '.join(f'`{n}`' for n in found)} read it"
        else:
            problem = "no state of its dims is in it and has a derivative that reads it"
        _refuse(context, of, problem, "leave `of` out: then the whole system is implicit")
    return found[0], equation


def _refuse(context: Context, of: Located[str], problem: str, repair: str) -> NoReturn:
    context.findings.report(states.implicit_of_what(of.value, problem, of.span, repair))
    raise LoweringFailed


def _depends(builder: GraphBuilder, value: NodeId, on: NodeId) -> bool:
    """True if `value` depends on `on`."""
    return needed(builder.graph(), (value,))[on]
