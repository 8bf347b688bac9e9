"""Finds operations with an infinite derivative within the ranges that a spec declares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.analyses.intervals import Interval, ValueRanges, holding
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import calculus as errors
from spec_schema.late_dataclass import dataclass

_Guard = tuple[NodeId, bool]
"""A bool node, and the value that it must have."""


def infinite_slopes(program: Program) -> list[Diagnostic]:
    """Warnings (W0743) of operations whose derivative is infinite somewhere within the declared
    ranges of a program.

    The program is in window form. There is no warning if the argument is not bounded by declared
    ranges, or if its own derivative is 0 there, so that the product is 0. An integrator evaluates a
    formula at several stages; it is reported only if all evaluations are singular.
    """
    graph = program.step
    places: dict[Span, list[_Singular | None]] = {}
    ranges = ValueRanges(program)
    guards: dict[NodeId, frozenset[_Guard]] | None = None
    for node, made in graph:
        for argument, at in _arguments(graph, made, ranges):
            if made.span is None:
                # a node without a place in the spec cannot be reported
                continue
            # computed on demand: finding the guards visits the whole graph
            guards = _guards(program) if guards is None else guards
            reached = _reached(graph, argument, at, ranges, guards[node])
            found = None if reached is None else _Singular(made, at, reached)
            places.setdefault(made.span, []).append(found)
    warned: list[Diagnostic] = []
    for span, all_found in places.items():
        found = [one for one in all_found if one is not None]
        # an integrator lowers a formula once per stage, and inner stages have no declared ranges:
        # one harmless evaluation suppresses the warning
        if len(found) == len(all_found):
            warned.append(_said(found[0], program, span))
    return warned


@dataclass(frozen=True, slots=True)
class _Singular:
    """An operation, the values of its argument at which its derivative is infinite, and the
    interval that the argument can reach.
    """

    node: Node
    at: tuple[float, ...]
    reached: Interval


def _arguments(
    graph: Graph, node: Node, ranges: ValueRanges
) -> Iterator[tuple[NodeId, tuple[float, ...]]]:
    """The operands with respect to which the node's derivative may be infinite, each with the
    values at which it is. `ranges` has the intervals of all nodes.
    """
    match node.op:
        case ops.Divide():
            yield node.args[1], (0.0,)
        case ops.Apply("log"):
            yield node.args[0], (0.0,)
        case ops.Apply("sqrt") if not _is_flat(graph, node.args[0]):
            yield node.args[0], (0.0,)
        case ops.Apply("pow") if not _is_flat(graph, node.args[0]):
            exponent = ranges.of(node.args[1])
            # x^y has an infinite derivative at 0 for y < 1; y = 0 is the constant 1
            if exponent.low < 1.0 and (exponent.low, exponent.high) != (0.0, 0.0):
                yield node.args[0], (0.0,)
        # a clipped argument is within the domain and reaches the bound only by chance
        case ops.Apply("asin" | "acos") if not isinstance(graph[node.args[0]].op, ops.Clamp):
            yield node.args[0], (-1.0, 1.0)
        case _:
            pass


def _is_flat(graph: Graph, node: NodeId) -> bool:
    """True if the derivative of the value is 0 wherever the value is 0, as for squares, magnitudes,
    relu and sums of them.
    """
    made = graph[node]
    match made.op:
        case ops.Apply("abs"):
            return True
        case ops.Constant(values):
            return min(values, default=0.0) >= 0.0
        case ops.Maximum():
            # a tie belongs to the first operand: relu(x) is max(0, x), with derivative 0 at 0
            return _is_flat(graph, made.args[0])
        case ops.Multiply():
            # x·x and |x|, scaled and summed: √ of them is singular at 0, but their own derivative
            # is 0 there, and the product counts as 0 (decision 0184)
            left, right = made.args
            scaled = any(isinstance(graph[arg].op, ops.Constant) for arg in made.args)
            return left == right or (scaled and _is_flat(graph, left) and _is_flat(graph, right))
        case ops.Add() | ops.Concat():
            return all(_is_flat(graph, arg) for arg in made.args)
        case ops.Sum() | ops.Broadcast() | ops.Reshape() | ops.Slice():
            return _is_flat(graph, made.args[0])
        case _:
            return False


def _reached(
    graph: Graph,
    argument: NodeId,
    at: tuple[float, ...],
    ranges: ValueRanges,
    guards: Iterable[_Guard],
) -> Interval | None:
    """The interval of the node `argument` under the conditions `guards`, if it follows from
    declared ranges and contains one of the singular values `at`; else None.
    """
    found = ranges.of(argument)
    # not bounded by declared ranges: a warning would be a guess
    if not found.of or not any(map(found.has, at)):
        return None
    given: dict[NodeId, Interval] = {}
    for condition, holds in guards:
        for node, known in holding(graph, condition, ranges, holds=holds).items():
            given[node] = known.within(given[node]) if node in given else known
    found = ranges.of(argument, given)
    return found if any(map(found.has, at)) else None


def _guards(program: Program) -> dict[NodeId, frozenset[_Guard]]:
    """For each node, the conditions that hold whenever its value is used: those of the `where`
    branches around all its uses.
    """
    graph = program.step
    results = [one.node for one in program.outputs] + [one.next for one in program.states]
    for loss in program.losses:
        results += loss.nodes
    found = dict.fromkeys(results, frozenset[_Guard]())
    # users have larger ids: going backwards, all users of a node are known
    for node in reversed(range(len(graph))):
        made, own = graph[node], found.setdefault(node, frozenset())
        for position, arg in enumerate(made.args):
            chosen = isinstance(made.op, ops.Select) and position > 0
            here = own | {(made.args[0], position == 1)} if chosen else own
            # only conditions that all users share
            found[arg] = found[arg] & here if arg in found else here
    return found


def _said(one: _Singular, program: Program, span: Span) -> Diagnostic:
    entries = (*program.signals, *program.states, *program.expected)
    ranges = {entry.name: entry.range for entry in entries}
    declared = {name: limits for name in sorted(one.reached.of) if (limits := ranges[name])}
    name = one.node.op.function if isinstance(one.node.op, ops.Apply) else "/"
    at = [value for value in one.at if one.reached.has(value)]
    return errors.steep_within_ranges(name, at, declared, (one.reached.low, one.reached.high), span)
