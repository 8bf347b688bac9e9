"""Prevents NaN = 0 · ∞ in derivatives from the branch that a `Select` does not take."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import Axis

SINGULAR = frozenset({"sqrt", "log", "pow", "asin", "acos", "atan2", "exp", "sinh", "cosh"})
"""Functions with an infinite or NaN value or derivative somewhere; division is handled
separately."""

SAFE = 0.5
"""An argument at which all of them, and 1/x, have a finite value and derivative."""

# without a condition the guard holds more often, which is safe
LONGEST = 8
"""Maximum number of conditions of nested branches, the inner ones, so that the pass is linear."""


@dataclass(frozen=True, slots=True)
class BranchCondition:
    """A bool node, without its broadcasts, and the value that it has in the branch."""

    node: NodeId
    holds: bool


Guard = tuple[BranchCondition, ...]
"""Conditions that are true wherever the value is used, outermost first."""


def guard_untaken(program: Program) -> Program:
    """Gives divisions and singular functions a harmless argument where their branch is not taken.

    Before: any form. After: the same values; in reverse mode the untaken branch contributes 0 ·
    finite. A value that is also used outside the branch does not change.

        where(x > 0, sqrt(x), 0)
        where(x > 0, sqrt(where(x > 0, x, 0.5)), 0)
    """
    # start and step are separate graphs with separate guards
    roots = [output.node for output in program.outputs]
    roots += [state.next for state in program.states]
    roots += [node for loss in program.losses for node in loss.nodes]
    step, copies = guarded(program.step, roots)
    program = with_step(program, step.graph(), copies)
    start, copies = guarded(program.start, [state.start for state in program.states])
    return with_start(program, start.graph(), copies)


def guarded(graph: Graph, roots: Iterable[NodeId]) -> tuple[GraphBuilder, dict[NodeId, NodeId]]:
    """The guarded nodes that the roots depend on, and their new ids."""
    roots = list(roots)
    guards = _guards(graph, roots)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index in _order(graph, guards, roots):
        node, guard = graph[index], guards[index]
        args = tuple(copies[arg] for arg in node.args)
        # only singular operations: a guard costs an operation, and 0 times a finite derivative is 0
        if guard and _is_singular(node.op):
            conditions = [(copies[condition.node], condition.holds) for condition in guard]
            args = _harmless(builder, node, args, conditions)
        copies[index] = copy_node(builder, node, args)
    return builder, copies


def _harmless(
    builder: GraphBuilder,
    node: Node,
    args: tuple[NodeId, ...],
    conditions: list[tuple[NodeId, bool]],
) -> tuple[NodeId, ...]:
    # the numerator is harmless; dividing by 0 is not
    kept = args[:1] if isinstance(node.op, ops.Divide) else ()
    guarded: list[NodeId] = []
    for arg in args[len(kept) :]:
        type = builder.type(arg)
        safe = builder.broadcast(builder.constant(SAFE), type.axes)
        # from the innermost condition to the outermost, each selects from the previous result
        for condition, holds in reversed(conditions):
            wide = builder.broadcast(condition, type.axes)
            branches = (arg, safe) if holds else (safe, arg)
            arg = builder.emit(ops.Select(), (wide, *branches), type)
        guarded.append(arg)
    return (*kept, *guarded)


def _guards(graph: Graph, roots: list[NodeId]) -> list[Guard | None]:
    """For each node the conditions that hold at all its uses; None if it is unused."""
    guards: list[Guard | None] = [None] * len(graph)
    for root in roots:
        # a root is used unconditionally
        guards[root] = ()
    for index in reversed(range(len(graph))):
        node, guard = graph[index], guards[index]
        # no root depends on it
        if guard is None:
            continue
        for place, arg in enumerate(node.args):
            under = guard
            if isinstance(node.op, ops.Select) and place > 0:
                # a branch of a `where` is used where the condition holds, or where it does not
                condition = BranchCondition(graph.unrepeated(node.args[0]), place == 1)
                # an inner use of the same condition replaces the outer one
                under = (*(c for c in guard if c.node != condition.node), condition)[-LONGEST:]
            under = tuple(
                c for c in under if _reaches(graph[c.node].type.axes, node.op, graph[arg].type.axes)
            )
            before = guards[arg]
            # only conditions that all uses share are true wherever the value is used
            guards[arg] = under if before is None else tuple(c for c in before if c in under)
    return guards


def _reaches(condition: tuple[Axis, ...], op: ops.Op, operand: tuple[Axis, ...]) -> bool:
    """True if a condition on the elements of a value also applies to those of its operand."""
    match op:
        # a reshape moves the elements of a condition with axes
        case ops.Reshape():
            return not condition
        case ops.Slice(axis) | ops.Concat(axis):
            return set(condition) <= {a for a in operand if a.name != axis}
        case _:
            return set(condition) <= set(operand)


def _is_singular(op: ops.Op) -> bool:
    return isinstance(op, ops.Divide) or (isinstance(op, ops.Apply) and op.function in SINGULAR)


def _order(graph: Graph, guards: list[Guard | None], roots: list[NodeId]) -> list[NodeId]:
    """Needed nodes, each after its operands and the conditions of its guard.

    Such an order exists. Suppose c depended on a node that c′ guards, and c′ on one that c guards.
    Then every `Select` by c would be in a branch of one by c′ and vice versa. That is impossible
    for the last of them in the order of the graph.
    """
    order: list[NodeId] = []
    placed = [False] * len(graph)
    for root in roots:
        # an explicit stack, as graphs are deeper than Python's recursion limit; a node is ready at
        # its second visit
        stack = [(root, False)]
        while stack:
            index, ready = stack.pop()
            if placed[index]:
                continue
            if ready:
                placed[index] = True
                order.append(index)
                continue
            node, guard = graph[index], guards[index]
            needs = [*node.args]
            if guard and _is_singular(node.op):
                needs += [condition.node for condition in guard]
            stack.append((index, True))
            stack.extend((need, False) for need in reversed(needs) if not placed[need])
    return order
