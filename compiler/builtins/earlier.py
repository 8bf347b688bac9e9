"""The value that an expression had one sample ago, whatever it depends on (R5, R8)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.ir.ops import Relation
from compiler.ir.program import Memory, NodeId, State
from compiler.ir.types import Type
from compiler.lowering.environment import Environment, Part
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import calculus, names
from spec_schema.expressions.text import expression_text
from spec_schema.expressions.tree import Call

if TYPE_CHECKING:
    from compiler.elaboration.names import Model

_START = Environment(Part.START)


def earlier(model: Model, call: Call, environment: Environment) -> NodeId:
    """The argument of a call at t−1; where nothing says what it was before t0, its value at t0.

    Its signals are read a sample earlier wherever that can be. What depends on a simulation whose
    past is not known is remembered instead.
    """
    argument = call.arguments[0]
    before = environment.shifted(-1)
    if environment.part is Part.START or environment.latest > 0:
        lower(model, argument, environment)  # a mistake in it is one at t, not one of its past
        return lower(model, argument, before)
    known = model.entries.tried(lambda: lower(model, argument, before.at_start()))
    if known is not None:
        return lower(model, argument, before)
    return _remembered(model, call, environment)


def in_the_step(model: Model, call: Call, environment: Environment) -> Environment:
    """The environment of a call that keeps memory: at t, and held over a vector field (R6)."""
    function = call.function
    name = expression_text(function)
    if environment.part is Part.START or environment.part is Part.CONSTANT:
        place = environment.part.value
        model.findings.report(names.misplaced(name, place, function.span))
        raise LoweringFailed
    if environment.is_elsewhere:
        model.findings.report(calculus.memory_at_another_time(name, call.span))
        raise LoweringFailed
    if environment.stage is not None and environment.arguments:
        where = "a function that a vector field calls"
        model.findings.report(names.misplaced(name, where, function.span))
        raise LoweringFailed
    return environment.without_stage()


def one_sample(model: Model, call: Call, environment: Environment) -> NodeId:
    """The argument of a call that keeps memory; LoweringFailed where it is a window."""
    argument = call.arguments[0]
    node = lower(model, argument, environment)
    if model.builder(environment).type(node).window is not None:
        name = expression_text(call.function)
        model.findings.report(calculus.memory_of_window(name, argument.span))
        raise LoweringFailed
    return node


def keep(
    model: Model,
    call: Call,
    name: str,
    following: NodeId,
    start: NodeId,
    environment: Environment,
    *,
    of_run: bool = False,
) -> None:
    """Makes the state that a call keeps; `start` is a node of the start graph."""
    type = model.builder(environment).type(following)
    doc = f"memory of {expression_text(call)}"
    model.memories.keep(
        State(name, type.axes, type.unit, Memory(of_run), following, start, None, doc, call.span)
    )


def _remembered(model: Model, call: Call, environment: Environment) -> NodeId:
    """The value of the last step; at t0, as a state that is 1 there tells, the one of this step."""
    environment = in_the_step(model, call, environment)
    now = one_sample(model, call, environment)
    builder, start = model.builder(environment), model.builder(_START)
    type = builder.type(now)
    name = model.memories.name("previous", (now,))
    zero = start.broadcast(start.constant(0.0, unit=type.unit), type.axes)
    keep(model, call, name, now, zero, environment, of_run=True)
    first = model.memories.name("first_step", ())
    model.memories.keep(
        State(
            first,
            (),
            None,
            Memory(of_run=True),
            builder.constant(0.0, unit=None),
            start.constant(1.0, unit=None),
            None,
            "1 in the first step of a run",
        )
    )
    begins = builder.compare(
        Relation.GREATER, builder.state(first, Type()), builder.constant(0.5, unit=None)
    )
    return builder.select(begins, now, builder.state(name, type))
