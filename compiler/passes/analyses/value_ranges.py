"""Bounds the values of a step from the ranges that the spec declares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

import numpy as np

from compiler.ir import ops
from compiler.ir.program import Graph, History, Node, NodeId, Parameter, Program, Tape
from compiler.passes.analyses import intervals
from compiler.passes.analyses.intervals import ANYTHING, Interval

# a sigmoid of the raw variable reaches the bounds at ∞ only
_OPEN = 1e-9
"""Relative margin of the bounds of learned parameters, which are never reached."""


class ValueRanges:
    """The intervals of the nodes of a program's step in window form; each is computed once."""

    def __init__(self, program: Program) -> None:
        self._graph = program.step
        self._signals = _declared(program)
        self._buffers = {state.name: _source(state.name, state.origin) for state in program.states}
        self._parameters = {p.name: _of_parameter(p) for p in program.parameters}
        self._expected = {one.node: _of_range(one.name, one.range) for one in program.expected}
        self._known: dict[NodeId, Interval] = {}

    def of(self, node: NodeId, given: Mapping[NodeId, Interval] | None = None) -> Interval:
        """The interval of a node; `given` are additional bounds, such as those in a branch of
        `where`.
        """
        known = self._known if not given else {}
        return self._found(node, given or {}, known)

    def _found(
        self, wanted: NodeId, given: Mapping[NodeId, Interval], known: dict[NodeId, Interval]
    ) -> Interval:
        # an explicit stack: expressions are deeper than Python's recursion limit
        waiting = [wanted]
        while waiting:
            node = waiting[-1]
            missing = [arg for arg in self._graph[node].args if arg not in known]
            if node not in known and not missing:
                made = self._graph[node]
                found = self._interval(made, [known[arg] for arg in made.args])
                for limit in (self._expected.get(node), given.get(node)):
                    # an equation with a range is assumed to keep it (decision 0120)
                    found = found if limit is None else found.within(limit)
                known[node] = found
            if node in known:
                waiting.pop()
            else:
                waiting += missing
        return known[wanted]

    def _interval(self, node: Node, of: list[Interval]) -> Interval:
        match node.op:
            case ops.Constant(values):
                return _of_numbers(values)
            case ops.ReadParameter(name):
                return self._parameters[name]
            case ops.ReadSignal(name) | ops.ReadLog(name):
                return self._signals.get(name, ANYTHING)
            case ops.ReadState(name):
                # samples in a buffer have the range of its source
                return self._signals.get(self._buffers[name], ANYTHING)
            case ops.Window(name):
                past = self._signals.get(self._buffers[name], ANYTHING)
                return intervals.union([past, of[0]])
            case ops.Add():
                return intervals.total(of[0], of[1])
            case ops.Subtract():
                return intervals.total(of[0], intervals.negative(of[1]))
            case ops.Multiply() if node.args[0] == node.args[1]:
                return intervals.square(of[0])
            case ops.Multiply():
                return intervals.product(of[0], of[1])
            case ops.Divide():
                return intervals.quotient(of[0], of[1])
            case ops.Negate():
                return intervals.negative(of[0])
            case ops.Minimum():
                return intervals.least(of[0], of[1])
            case ops.Maximum():
                return intervals.largest(of[0], of[1])
            case ops.Clamp():
                return intervals.clamped(of[0], of[1], of[2])
            case ops.Select():
                return intervals.union(of[1:])
            case ops.Apply(function):
                return intervals.of_function(function, of)
            case ops.Identity() | ops.Broadcast() | ops.Reshape() | ops.Slice():
                return of[0]
            case ops.Concat():
                return intervals.union(of)
            case ops.Sum(axis=axis):
                return intervals.repeated(of[0], self._length(node.args[0], axis))
            case ops.Contract(axis=axis):
                length = self._length(node.args[0], axis)
                return intervals.repeated(intervals.product(of[0], of[1]), length)
            case ops.Compare() | ops.ReadTraining():
                return ANYTHING
            case _:
                assert_never(node.op)

    def _length(self, node: NodeId, axis: str) -> int:
        found = self._graph[node].type.axis(axis)
        assert found is not None, "a sum runs over an axis of its operand"
        return found.size


def holding(
    graph: Graph, condition: NodeId, ranges: ValueRanges, *, holds: bool
) -> dict[NodeId, Interval]:
    """The intervals of a comparison's operands if it is true, or if it is false."""
    # a condition is broadcast if its branches have more axes
    node = graph[graph.unrepeated(condition)]
    if not isinstance(node.op, ops.Compare):
        return {}
    left, right = node.args
    relation = node.op.relation if holds else _OTHERWISE[node.op.relation]
    if relation in (ops.Relation.GREATER, ops.Relation.GREATER_EQUAL):
        left, right = right, left
    strict = relation in (ops.Relation.LESS, ops.Relation.GREATER)
    most, fewest = ranges.of(right).high, ranges.of(left).low
    found: dict[NodeId, Interval] = {}
    # strictly less: the largest float below the other bound
    _add(graph, found, left, Interval(high=math.nextafter(most, -math.inf) if strict else most))
    _add(graph, found, right, Interval(low=math.nextafter(fewest, math.inf) if strict else fewest))
    return found


# without NaN, for which neither relation holds; declared ranges exclude it
_OTHERWISE = {
    ops.Relation.LESS: ops.Relation.GREATER_EQUAL,
    ops.Relation.LESS_EQUAL: ops.Relation.GREATER,
    ops.Relation.GREATER: ops.Relation.LESS_EQUAL,
    ops.Relation.GREATER_EQUAL: ops.Relation.LESS,
}
"""The relation that holds if the key does not."""


def _add(graph: Graph, found: dict[NodeId, Interval], node: NodeId, known: Interval) -> None:
    """Adds bounds of a node, and the bounds of its operands that follow."""
    found[node] = known.within(found.get(node, ANYTHING))
    made = graph[node]
    if isinstance(made.op, ops.Broadcast):
        # bounds of a broadcast value are bounds of its operand
        _add(graph, found, made.args[0], known)
    even = isinstance(made.op, ops.Multiply) and made.args[0] == made.args[1]
    if known.low > 0.0 and (made.op == ops.Apply("abs") or even):
        _add(graph, found, made.args[0], Interval(nonzero=True))


def _declared(program: Program) -> dict[str, Interval]:
    entries = (*program.signals, *program.states, *program.expected)
    return {one.name: _of_range(one.name, one.range) for one in entries if one.range is not None}


def _of_range(name: str, range: tuple[float, float]) -> Interval:
    return Interval(range[0], range[1], frozenset([name]))


def _source(name: str, origin: object) -> str:
    """The name whose samples a state stores."""
    match origin:
        case History(source) | Tape(source):
            return source
        case _:
            return name


def _of_parameter(parameter: Parameter) -> Interval:
    """The bounds of a learned parameter, otherwise its initial value."""
    if not parameter.learn or (parameter.minimum is None and parameter.maximum is None):
        # training may change it, but before training the initial value is the best guess
        return _of_numbers(parameter.initial)
    low = -math.inf if parameter.minimum is None else parameter.minimum
    high = math.inf if parameter.maximum is None else parameter.maximum
    margin = _OPEN * parameter.scale
    return Interval(low + margin, high - margin)


def _of_numbers(values: tuple[float, ...]) -> Interval:
    numbers = np.asarray(values, float)
    if not numbers.size or np.isnan(numbers).any():
        return ANYTHING
    # 0 is between −1 and 2 although no element is 0
    return Interval(float(numbers.min()), float(numbers.max()), nonzero=bool(numbers.all()))
