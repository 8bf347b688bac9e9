"""Keeps the branch that a `Select` does not take from spoiling derivatives with 0 · ∞ = NaN."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import Axis

SINGULAR = frozenset({"sqrt", "log", "pow", "asin", "acos", "atan2", "exp", "sinh", "cosh"})
"""Functions whose value or slope is infinite or NaN somewhere; division is the other operation."""

SAFE = 0.5
"""An argument at which all of them, and 1/x, have a finite value and slope."""

# dropping a condition leaves a guard that holds more often, which is safe
LONGEST = 8
"""Conditions that are kept of a deeper nest, the inner ones, so that the pass stays linear."""


@dataclass(frozen=True, slots=True)
class BranchCondition:
    """A bool node without its broadcasts, and which of its values the branch belongs to."""

    node: NodeId
    holds: bool


Guard = tuple[BranchCondition, ...]
"""All of these are true wherever anything uses the value; the outermost comes first."""


def guard_untaken(program: Program) -> Program:
    """Gives divisions and singular functions a harmless argument where no branch takes their value.

    Before: any form. After: the same values; in reverse mode the untaken branch sends 0 · finite.
    A value that is also used outside of the branch stays as it is.

        where(x > 0, sqrt(x), 0)
        where(x > 0, sqrt(where(x > 0, x, 0.5)), 0)
    """
    # start and step are graphs of their own: what guards the one says nothing of the other
    roots = [output.node for output in program.outputs]
    roots += [state.next for state in program.states]
    roots += [node for loss in program.losses for node in loss.nodes]
    step, copies = guarded(program.step, roots)
    program = with_step(program, step.graph(), copies)
    start, copies = guarded(program.start, [state.start for state in program.states])
    return with_start(program, start.graph(), copies)


def guarded(graph: Graph, roots: Iterable[NodeId]) -> tuple[GraphBuilder, dict[NodeId, NodeId]]:
    """The guarded nodes that the roots are made of, and where each of them is now."""
    roots = list(roots)
    guards = _guards(graph, roots)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index in _order(graph, guards, roots):
        node, guard = graph[index], guards[index]
        args = tuple(copies[arg] for arg in node.args)
        # only what can be infinite: a guard costs an operation, and 0 times a finite slope is 0
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
        # from the inner condition to the outer one: each chooses between what the one inside leaves
        for condition, holds in reversed(conditions):
            wide = builder.broadcast(condition, type.axes)
            branches = (arg, safe) if holds else (safe, arg)
            arg = builder.emit(ops.Select(), (wide, *branches), type)
        guarded.append(arg)
    return (*kept, *guarded)


def _guards(graph: Graph, roots: list[NodeId]) -> list[Guard | None]:
    """For each node the conditions that hold at all its uses, None where nothing uses it."""
    guards: list[Guard | None] = [None] * len(graph)
    for root in roots:
        # a root is used unconditionally: nothing above it guards it
        guards[root] = ()
    for index in reversed(range(len(graph))):
        node, guard = graph[index], guards[index]
        # nothing that counts is made of it
        if guard is None:
            continue
        for place, arg in enumerate(node.args):
            under = guard
            if isinstance(node.op, ops.Select) and place > 0:
                # an operand of a `where` is used where the condition holds, or where it does not
                condition = BranchCondition(graph.unrepeated(node.args[0]), place == 1)
                # the same condition again, further in, decides: the outer one is contradicted or
                # repeated
                under = (*(c for c in guard if c.node != condition.node), condition)[-LONGEST:]
            under = tuple(
                c for c in under if _reaches(graph[c.node].type.axes, node.op, graph[arg].type.axes)
            )
            before = guards[arg]
            # of several uses only the conditions that all share are true wherever the value is used
            guards[arg] = under if before is None else tuple(c for c in before if c in under)
    return guards


def _reaches(condition: tuple[Axis, ...], op: ops.Op, operand: tuple[Axis, ...]) -> bool:
    """Whether a condition on the elements of a value is one on those of its operand too."""
    match op:
        # after a reshape the elements of a condition with axes stand elsewhere
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

    There is such an order. Were c computed from a node that c′ guards, and c′ from one that c
    guards, then every `Select` by c would lie in a branch of one by c′ and the other way round; the
    last of them in the graph's order cannot.
    """
    order: list[NodeId] = []
    placed = [False] * len(graph)
    for root in roots:
        # a stack of its own, as graphs are deeper than Python nests; a node is ready when it is met
        # again
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
