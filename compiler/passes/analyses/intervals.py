"""Interval arithmetic for the values of nodes: each interval bounds all elements of a value, and
names the declared ranges from which it follows.

An unknown value has infinite ends and follows from no range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import assert_never

import numpy as np

from compiler.ir import ops
from compiler.ir.program import Graph, History, Node, NodeId, Parameter, Program, Tape
from compiler.ir.scalars import SCALAR_FUNCTIONS
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval low ≤ x ≤ high that contains every element x of a value."""

    low: float = -math.inf
    high: float = math.inf
    of: frozenset[str] = frozenset()
    """The names whose declared ranges the interval follows from."""
    nonzero: bool = False
    """True if no element is 0 although 0 may be between the ends."""

    def has(self, value: float) -> bool:
        """True if an element in the interval can have this value."""
        return self.low <= value <= self.high and not (value == 0 and self.nonzero)

    def within(self, other: Interval) -> Interval:
        """The intersection of this interval with `other`; this interval unchanged if it
        is empty.
        """
        low, high = max(self.low, other.low), min(self.high, other.high)
        if low > high:  # an empty intersection: the declared ranges contradict each other
            return self
        return Interval(low, high, self.of | other.of, self.nonzero or other.nonzero)


ANYTHING = Interval()


def union(parts: Sequence[Interval]) -> Interval:
    """The smallest interval that contains all of `parts`."""
    ends = [end for one in parts for end in (one.low, one.high)]
    return replace(_between(ends, *parts), nonzero=not any(one.has(0.0) for one in parts))


def negative(x: Interval) -> Interval:
    return replace(x, low=-x.high, high=-x.low)


def total(a: Interval, b: Interval) -> Interval:
    return _between([a.low + b.low, a.high + b.high], a, b)


def product(a: Interval, b: Interval) -> Interval:
    # minimum and maximum of the four products of ends
    ends = [_times(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    found = _between(ends, a, b)
    # the product is 0 if one factor is 0, however large the other
    zero = _of([one for one in (a, b) if one.has(0.0)])
    nonzero = not a.has(0.0) and not b.has(0.0)
    return replace(found, of=found.of or zero, nonzero=nonzero)


# not `product(x, x)`: for −1 … 1 that is −1 … 1, but a square is 0 … 1
def square(x: Interval) -> Interval:
    return product(magnitude(x), magnitude(x))


def quotient(a: Interval, b: Interval) -> Interval:
    # a divisor near 0 makes the quotient unbounded
    if b.low <= 0.0 <= b.high:
        return ANYTHING
    return product(a, _between([1.0 / b.low, 1.0 / b.high], b))


def magnitude(x: Interval) -> Interval:
    ends = (abs(x.low), abs(x.high))
    # the minimum magnitude is 0 if both signs are possible
    low = 0.0 if x.low <= 0.0 <= x.high else min(ends)
    return replace(_between([low, max(ends)], x), nonzero=x.nonzero)


def least(a: Interval, b: Interval) -> Interval:
    return _between([min(a.low, b.low), min(a.high, b.high)], a, b)


def largest(a: Interval, b: Interval) -> Interval:
    return _between([max(a.low, b.low), max(a.high, b.high)], a, b)


def clamped(x: Interval, low: Interval, high: Interval) -> Interval:
    return least(largest(x, low), high)


def repeated(x: Interval, count: int) -> Interval:
    """The interval of the sum of `count` values, each in the interval x."""
    return _between([_times(count, x.low), _times(count, x.high)], x)


def of_function(function: str, x: Sequence[Interval]) -> Interval:
    """The interval of the value of a scalar function, for arguments in the intervals `x`."""
    if function == "abs":
        return magnitude(x[0])
    if function == "pow":
        return _power(*x)
    if function in _MONOTONE:
        low, high = _MONOTONE[function]
        meaning = SCALAR_FUNCTIONS[function].numpy
        # arguments outside the domain give NaN, which does not count as a value
        inside = [min(max(end, low), high) for end in (x[0].low, x[0].high)]
        with np.errstate(all="ignore"):
            ends = [float(meaning(np.float64(end))) for end in inside]
        return _between(ends, x[0])
    if function in _PEAKS:
        return _wave(function, x[0])
    return _between(_BOUNDED.get(function, (-math.inf, math.inf)), *x)


def _wave(function: str, x: Interval) -> Interval:
    """The interval of `function`, "sin" or "cos", for angles in `x`: values at the ends, and
    extrema between them.
    """
    # an infinite interval contains all phases
    if not math.isfinite(x.high - x.low):
        return Interval(-1.0, 1.0)
    ends = [float(SCALAR_FUNCTIONS[function].numpy(np.float64(end))) for end in (x.low, x.high)]
    for peak, value in ((_PEAKS[function], 1.0), (_PEAKS[function] + math.pi, -1.0)):
        # the first such phase at or after the start of the interval
        next_one = peak + math.ceil((x.low - peak) / (2.0 * math.pi)) * 2.0 * math.pi
        ends += [value] if next_one <= x.high else []
    return _between(ends, x)


_PEAKS = {"sin": math.pi / 2.0, "cos": 0.0}
"""Arguments of a maximum 1; the minimum −1 is half a turn further."""


_MONOTONE = {
    "exp": (-math.inf, math.inf),
    "sinh": (-math.inf, math.inf),
    "tanh": (-math.inf, math.inf),
    "atan": (-math.inf, math.inf),
    "sigmoid": (-math.inf, math.inf),
    "softplus": (-math.inf, math.inf),
    "sign": (-math.inf, math.inf),
    "sqrt": (0.0, math.inf),
    "log": (0.0, math.inf),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
}
"""Monotone functions and their domains."""

# not monotone, but bounded for any argument
_BOUNDED = {"atan2": (-math.pi, math.pi), "cosh": (1.0, math.inf)}


# with a variable exponent, a power of a nonnegative base is known to be ≥ 0 only
def _power(base: Interval, exponent: Interval) -> Interval:
    # x^y of a negative base is NaN for most y
    if exponent.low != exponent.high:
        return Interval(low=0.0) if base.low >= 0.0 else ANYTHING
    y = exponent.low
    if base.low < 0.0:
        # an even power depends on the magnitude only; other exponents are not analysed
        even = y > 0.0 and y % 2.0 == 0.0
        return _power(magnitude(base), exponent) if even else ANYTHING
    with np.errstate(all="ignore"):
        ends = [float(np.float64(end) ** y) for end in (base.low, base.high)]
    return _between(ends, base)


# 0 · ∞ is NaN in IEEE arithmetic; here an infinite end means arbitrarily large
def _times(a: float, b: float) -> float:
    """The product of two ends of intervals, with 0 · ∞ = 0, since an infinite end means arbitrarily
    large.
    """
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _between(ends: Sequence[float], *made_of: Interval) -> Interval:
    """The interval from the minimum to the maximum of `ends`, computed from the intervals
    `made_of`. An unbounded one follows from no declared range.
    """
    # ∞ − ∞: the end is unknown
    if any(math.isnan(end) for end in ends):
        return ANYTHING
    low, high = min(ends), max(ends)
    bounded = math.isfinite(low) and math.isfinite(high)
    return Interval(low, high, _of(made_of) if bounded else frozenset())


def _of(parts: Sequence[Interval]) -> frozenset[str]:
    return frozenset[str]().union(*(one.of for one in parts))


# a sigmoid of the raw variable reaches the bounds at ∞ only
_OPEN = 1e-9
"""Relative margin of the bounds of learned parameters, which are never reached."""


class ValueRanges:
    """The intervals of the nodes of a program's step, in window form, from its declared ranges.
    Each is computed once.
    """

    def __init__(self, program: Program) -> None:
        self._graph = program.step
        self._signals = _declared(program)
        self._buffers = {state.name: _source(state.name, state.origin) for state in program.states}
        self._parameters = {p.name: _of_parameter(p) for p in program.parameters}
        self._expected = {one.node: _of_range(one.name, one.range) for one in program.expected}
        self._known: dict[NodeId, Interval] = {}

    def of(self, node: NodeId, given: Mapping[NodeId, Interval] | None = None) -> Interval:
        """The interval of a node; `given` are additional bounds of nodes, such as those that hold
        in a branch of `where`.
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
                return union([past, of[0]])
            case ops.Add():
                return total(of[0], of[1])
            case ops.Subtract():
                return total(of[0], negative(of[1]))
            case ops.Multiply() if node.args[0] == node.args[1]:
                return square(of[0])
            case ops.Multiply():
                return product(of[0], of[1])
            case ops.Divide():
                return quotient(of[0], of[1])
            case ops.Negate():
                return negative(of[0])
            case ops.Minimum():
                return least(of[0], of[1])
            case ops.Maximum():
                return largest(of[0], of[1])
            case ops.Clamp():
                return clamped(of[0], of[1], of[2])
            case ops.Select():
                return union(of[1:])
            case ops.Apply(function):
                return of_function(function, of)
            case ops.Identity() | ops.Broadcast() | ops.Reshape() | ops.Slice():
                return of[0]
            case ops.Concat():
                return union(of)
            case ops.Sum(axis=axis):
                return repeated(of[0], self._length(node.args[0], axis))
            case ops.Contract(axis=axis):
                length = self._length(node.args[0], axis)
                return repeated(product(of[0], of[1]), length)
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
    """Bounds of the operands of a comparison, and of nodes inside them, that follow if it is true
    (`holds`) or false. `ranges` has the intervals of all nodes. Empty if the node `condition` is no
    comparison.
    """
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
    """Adds the bounds `known` of a node to `found`, and the bounds of its operands that follow from
    them.
    """
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
    """The name whose samples the state `name` stores: the source of a buffer, by its `origin`,
    otherwise the state itself.
    """
    match origin:
        case History(source) | Tape(source):
            return source
        case _:
            return name


def _of_parameter(parameter: Parameter) -> Interval:
    """The interval of a parameter: the bounds of a learned one if it has any, otherwise its initial
    values.
    """
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
