"""Finds the decisions of a step and its Jacobian: comparisons, kinks, poles, limits of states."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.status import StateCheck
from backends.c.selftest.singles.trial_steps import TrialValues
from backends.c_lowering.fuzzy_sets import sums_of_active_sets
from compiler.interpreter.operations import repeated_batch
from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.program import Expected, Graph, NodeId, Program
from compiler.jacobian.matrices import Jacobian

Array = NDArray[Any]

_ELEMENTS = 32
"""Maximum number of elements per value; further elements are checked in the same loop."""
UNORDERED = 2
"""The sign of a difference that is NaN."""

_AT_ZERO = ("abs", "sign", "sqrt", "log", "pow", "atan2")
"""Functions with a kink, a pole or an end of their domain where the first operand is 0."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Two nodes whose comparison (less, equal, greater) decides how a result is computed. `right`
    is None for a comparison with 0.
    """

    left: NodeId
    right: NodeId | None


Sides = tuple[Array, Array]
"""Both sides of a comparison, (B, …), or (1, …) for a side that is equal in all trials."""


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two values that are compared element by element: `size` is the number of elements, `sides`
    gives both from the results of steps.
    """

    size: int
    sides: Callable[[TrialValues], Sides]


class Decisions:
    """All comparisons of a step, its checks and its Jacobian: each element of each is one decision,
    the sign of a difference. Also lists the entries of the Jacobian that can be infinite.
    """

    def __init__(self, program: Program, interface: Interface) -> None:
        self._dtype = np.dtype(interface.options.dtype)
        self._checks = interface.checks
        self._expected = program.expected
        jacobian = interface.jacobian.jacobian if interface.jacobian else None
        self._sparse = sums_of_active_sets(program, interface.states)
        self._doubtful = _doubtful(jacobian) if jacobian else []
        results = [output.node for output in program.outputs]
        results += [state.next for state in program.states]
        self._pairs = _pairs(program.step, results, lambda values: values.nodes)
        if jacobian:
            self._pairs += _pairs(jacobian.graph, jacobian.roots, lambda values: values.slopes)
        self._pairs += [self._at_limit(c, limit) for c in self._checks for limit in c.limits]
        for entry in self._expected:
            size = program.step[entry.node].type.size
            self._pairs += [self._expectation(entry, limit, size) for limit in entry.range]
        self._ends = np.cumsum([0, *(pair.size for pair in self._pairs)])[1:]

    @property
    def every(self) -> NDArray[np.int64]:
        """The indices of all decisions, 0 … D−1."""
        return np.arange(sum(pair.size for pair in self._pairs))

    def signs(self, values: TrialValues, count: int) -> NDArray[np.int8]:
        """The sign of each difference in each of `count` steps: -1, 0, 1, or `UNORDERED` for NaN;
        (count, D) with D decisions.
        """
        found = [_signs(*pair.sides(values), count) for pair in self._pairs]
        return np.concatenate([np.zeros((count, 0), np.int8), *found], axis=1)

    def gaps(self, values: TrialValues, count: int, which: NDArray[np.int64]) -> Array:
        """The absolute differences of the decisions with the indices `which` in each of `count`
        steps, (count, len(which)); infinite for NaN.
        """
        found = np.empty((count, len(which)))
        owners = np.searchsorted(self._ends, which, side="right")
        for number in map(int, np.unique(owners)):
            own, pair = owners == number, self._pairs[number]
            columns = which[own] - (self._ends[number] - pair.size)
            found[:, own] = _gaps(*pair.sides(values), count)[:, columns]
        return found

    def _at_limit(self, check: StateCheck, limit: float) -> _Pair:
        state, right = check.memory.state, np.asarray(limit, self._dtype)
        return _Pair(
            check.part(np.empty([axis.size for axis in state.axes])).size,
            lambda values: (check.part(values.next_state(state.name)), right),
        )

    def _expectation(self, entry: Expected, limit: float, size: int) -> _Pair:
        right = np.asarray(limit, self._dtype)
        return _Pair(size, lambda values: (values.nodes[entry.node], right))

    def doubtful(self, values: TrialValues, count: int) -> Array:
        """The Jacobian entries that can be infinite, in each of `count` steps, (count, entries)."""
        if not self._doubtful:
            return np.zeros((count, 0))
        numbers = {
            node: repeated_batch(values.slopes[node], count).reshape(count, -1)
            for node, _ in self._doubtful
        }
        return np.stack([numbers[node][:, element] for node, element in self._doubtful], axis=1)

    def reports(self, values: TrialValues, count: int) -> Iterator[tuple[Array, Array]]:
        """For each finite limit of each checked element, two arrays (count,). The first is the
        excess beyond the limit, relative to the limit; negative if within. The second is True where
        no other element is out of range.
        """
        numbers: list[tuple[Array, tuple[float, float]]] = []
        for check in self._checks:
            part = check.part(values.next_state(check.memory.state.name)).reshape(count, -1)
            numbers += [(column, check.limits) for column in part.T[:_ELEMENTS]]
        for entry in self._expected:
            value = repeated_batch(values.nodes[entry.node], count).reshape(count, -1)
            numbers += [(column, entry.range) for column in value.T[:_ELEMENTS]]
        outside = [~((x >= low) & (x <= high)) for x, (low, high) in numbers]
        # a report that others make too tells nothing of this limit
        every = np.sum(outside, axis=0) if outside else np.zeros(count)
        for (x, limits), own in zip(numbers, outside, strict=True):
            for limit, sign in zip(limits, (-1.0, 1.0), strict=True):
                if np.isfinite(limit):
                    with np.errstate(invalid="ignore"):  # the conversion of a signalling NaN
                        # a limit of 0 has no size to be relative to
                        beyond = sign * (x.astype(np.float64) - limit) / max(abs(limit), 1e-3)
                    yield beyond, every == own

    def settled(self, values: TrialValues, count: int) -> NDArray[np.bool_]:
        """The mask (count,) of the steps for which C must give the same bits as the interpreter. C
        omits terms of fuzzy sets whose factor is 0; the interpreter computes NaN for them if the
        other factor is infinite.
        """
        found = np.ones(count, np.bool_)
        for node in self._sparse:
            value = values.nodes[node]
            found &= np.isfinite(value).reshape(len(value), -1).all(axis=1)
        return found


def _doubtful(jacobian: Jacobian) -> list[tuple[NodeId, int]]:
    """Node id and element index of each Jacobian entry that can be infinite. Entries that share an
    element are listed once: `y: next(x)` has the derivatives of x.
    """
    found: dict[tuple[NodeId, int], None] = {}
    for matrix in jacobian.matrices:
        written: dict[int, tuple[NodeId, int]] = {}
        checked: set[int] = set()
        for block in matrix.blocks:
            places = block.places(jacobian.graph[block.node].type.shape).ravel().tolist()
            written |= {place: (block.node, k) for k, place in enumerate(places)}
            checked |= set(places) if block.can_be_infinite else set()
        found |= dict.fromkeys(written[place] for place in sorted(checked))
    return [*found]


def _pairs(
    graph: Graph, roots: Iterable[NodeId], of: Callable[[TrialValues], Mapping[NodeId, Array]]
) -> list[_Pair]:
    live = needed(graph, roots)
    every = [d for index, _ in graph if live[index] for d in _of(graph, index)]
    return [_pair(graph, difference, of) for difference in dict.fromkeys(every)]


def _pair(
    graph: Graph, difference: Difference, of: Callable[[TrialValues], Mapping[NodeId, Array]]
) -> _Pair:
    left, right = difference.left, difference.right
    if right is None:
        return _Pair(graph[left].type.size, lambda values: (of(values)[left], np.zeros(())))
    shape = np.broadcast_shapes(graph[left].type.shape, graph[right].type.shape)
    return _Pair(math.prod(shape), lambda values: (of(values)[left], of(values)[right]))


def _of(graph: Graph, index: NodeId) -> Iterator[Difference]:
    node = graph[index]
    match node.op:
        case ops.Compare() | ops.Minimum() | ops.Maximum():
            yield Difference(*node.args)
        case ops.Clamp():
            value, low, high = node.args
            yield Difference(value, low)
            yield Difference(value, high)
        case ops.Apply(function) if function in _AT_ZERO:
            yield Difference(node.args[0], None)
        case ops.Divide():
            yield Difference(node.args[1], None)
        case _:
            pass


def _signs(left: Array, right: Array, count: int) -> NDArray[np.int8]:
    with np.errstate(invalid="ignore"):
        signs = (left > right).astype(np.int8) - (left < right).astype(np.int8)
        # both comparisons are false for NaN, which would look like equality
        signs[np.isnan(left) | np.isnan(right)] = UNORDERED
    return repeated_batch(signs, count).reshape(count, -1)


def _gaps(left: Array, right: Array, count: int) -> Array:
    with np.errstate(invalid="ignore", over="ignore"):
        gaps = np.abs(np.subtract(left, right, dtype=np.float64))
    gaps = np.where(left == right, 0.0, np.where(np.isnan(gaps), np.inf, gaps))
    return repeated_batch(gaps, count).reshape(count, -1)
