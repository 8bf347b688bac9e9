"""Evaluates a graph like the reference interpreter and bounds the rounding error of each value.

The bounds hold for every program that computes the same nodes in the same precision, for any order
of summation and any fused products (decision 0180). A node that is a sum of n terms is within
`error` + (n−1)·u·Σ|terms| of its exact value. u is the unit roundoff, `error` the error of the
terms (Higham: Accuracy and Stability of Numerical Algorithms, 2002, ch. 3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.bounded import (
    Bounded,
    Taken,
    chosen,
    exact,
    moved,
    pushed,
    selected,
    unit_roundoff,
)
from compiler.interpreter.operations import NOWHERE, Array, Evaluator, LeafValues, evaluator
from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.ops import TrainingValue
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS

FUNCTION_ERROR = {"float32": 4e-6, "float64": 1e-14}
"""Maximum relative error of a scalar function in any backend. tests/native/test_lane_kernels
checks it for the kernels, which compilers may fuse and regroup."""

_SMALLEST_RESULT = 10.0
"""Factor of the smallest normal number; smaller results of a function have no relative accuracy."""


_SHORT = 0.5
"""Interval in rad within which the change of a sine is at most twice that at its ends and
halves."""


@dataclass(frozen=True, slots=True)
class _Given:
    """The values that one evaluation of a graph reads: log and rows, states, and values of
    training.
    """

    around: LeafValues
    states: Mapping[str, Bounded]
    training: Mapping[TrainingValue, Bounded]


# operations that are not sums: each has at most one rounding
_Extreme = ops.Minimum | ops.Maximum | ops.Clamp
_Alone = _Extreme | ops.Multiply | ops.Divide | ops.Compare | ops.Select | ops.Apply


class BoundedGraph:
    """Evaluates the `wanted` nodes of a graph in the precision `dtype`, with rounding bounds.

    `weights` are physical arrays by name. States and training values are arguments of each
    evaluation.
    """

    def __init__(
        self,
        graph: Graph,
        wanted: Iterable[NodeId],
        weights: Mapping[str, Array],
        dtype: np.dtype[Any],
    ) -> None:
        self.unit = unit_roundoff(dtype)
        self._graph, self._weights, self._dtype = graph, weights, dtype
        live = needed(graph, wanted)
        self._steps = [(index, node, self._evaluator(node)) for index, node in graph if live[index]]

    def run(
        self,
        log: Mapping[str, Array],
        t: NDArray[np.int64],
        states: Mapping[str, Bounded],
        training: Mapping[TrainingValue, Bounded] | None = None,
        taken: Mapping[NodeId, Taken] | None = None,
    ) -> list[Bounded]:
        """Evaluates the wanted nodes, and all nodes that they depend on, at the rows `t`, one per
        member, with these states. Returns a list indexed by node id; other entries are None.

        `training` has the values of `ReadTraining` nodes. `taken` prescribes the outcomes of some
        comparisons and signs, which then have no error.
        """
        found: list[Any] = [None] * len(self._graph)
        given = _Given(LeafValues(log, t, {}), states, training or {})
        with np.errstate(all="ignore"):
            for index, node, meaning in self._steps:
                args = [found[arg] for arg in node.args]
                found[index] = self._bounded(node, meaning, args, given)
                if taken and index in taken:
                    found[index] = taken[index].instead_of(found[index])
        return found

    @property
    def decisions(self) -> dict[NodeId, tuple[Any, ...]]:
        """The evaluated nodes that are discontinuous, comparisons and signs, in order, with their
        possible values.

        The `error` of an element of such a node is 0 if every program decides it identically.
        """
        found: dict[NodeId, tuple[Any, ...]] = {}
        for index, node, _ in self._steps:
            match node.op:
                case ops.Compare():
                    found[index] = (False, True)
                case ops.Apply("sign"):
                    found[index] = (-1.0, 0.0, 1.0)
                case _:
                    pass
        return found

    def _evaluator(self, node: Node) -> Evaluator | None:
        """A function that computes the node from a list of its operands only; None for a state or a
        value of training, which `run` receives.
        """
        op = node.op
        if isinstance(op, ops.ReadState | ops.ReadTraining):
            return None
        types = tuple(self._graph[arg].type for arg in node.args)
        # operands are passed as a separate list, not by their index in the graph
        in_order = replace(node, args=tuple(range(len(node.args))))
        return evaluator(in_order, types, self._weights, self._dtype)

    def _bounded(
        self, node: Node, meaning: Evaluator | None, args: Sequence[Bounded], given: _Given
    ) -> Bounded:
        op = node.op
        if meaning is None:
            assert isinstance(op, ops.ReadState | ops.ReadTraining)
            is_state = isinstance(op, ops.ReadState)
            return given.states[op.name] if is_state else given.training[op.value]
        match op:
            case ops.ReadState():
                raise AssertionError("states are given")
            case ops.Leaf():
                return exact(meaning([], given.around))
            case ops.Structure() | ops.Identity() | ops.Negate():
                return moved(meaning, args)
            case ops.Window(state):
                return pushed(meaning, args[0], state, given.states[state])
            case ops.Add() | ops.Subtract():
                left, right = args
                value = meaning([left.value, right.value], NOWHERE)
                error, terms = left.error + right.error, left.terms + right.terms
                # counters and row numbers: sums of integers below 2^p are exact
                if self._counts(left, terms) and self._counts(right, terms):
                    return exact(value)
                return self._sum(value, error, terms, left.count + right.count)
            case ops.Sum(axis):
                # values, errors and terms are summed by the same rule
                value, error, terms = (meaning([part], NOWHERE) for part in args[0].parts)
                return self._sum(value, error, terms, args[0].count * self._length(node, axis))
            case ops.Contract(axis):
                return self._contraction(meaning, args, self._length(node, axis))
            case _:
                return self._alone(op, meaning, args)

    def _alone(self, op: _Alone, meaning: Evaluator, args: Sequence[Bounded]) -> Bounded:
        """The value with bounds of an operation that is not a sum: the errors of its operands, and
        its own rounding. `meaning` evaluates the operation.
        """
        # error of each operand, including the rounding of its sum
        spreads = [one.spread(self.unit) for one in args]
        values = [one.value for one in args]
        match op:
            case ops.Multiply():
                return self._product(values, spreads)
            case ops.Divide():
                return self._quotient(values, spreads)
            case ops.Minimum() | ops.Maximum():
                left, right = args
                return self._extreme(left, right, least=isinstance(op, ops.Minimum))
            case ops.Clamp():
                x, low, high = args
                return self._extreme(self._extreme(x, low, least=False), high, least=True)
            case ops.Compare():
                left, right = (value.astype(float) for value in values)
                # comparing a value with itself tests for NaN
                allowed = np.where(args[0] is args[1], 0.0, spreads[0] + spreads[1])
                # exact operands compare identically in every program, also if they are equal
                decided = (allowed == 0) | (np.abs(left - right) > allowed)
                value = meaning(values, NOWHERE)
                # a bool is 0 or 1: the error is 1 where the comparison may be decided differently
                return Bounded(value, 1.0 - decided, value.astype(float), 1)
            case ops.Select():
                return selected(args, spreads)
            case ops.Apply(function):
                return self._applied(function, meaning(values, NOWHERE), values, spreads)
            case _:
                assert_never(op)

    # ---- rules

    def _counts(self, one: Bounded, terms: Array) -> bool:
        """True if all elements of `one` are exact integers so small that their sums are exact too.
        `terms` are the magnitudes of the elements.
        """
        whole = (one.value == np.rint(one.value)) & (one.error == 0.0) & (terms < 0.5 / self.unit)
        return one.count == 1 and bool(whole.all())

    @property
    def _smallest(self) -> float:
        return float(np.finfo(self._dtype).smallest_subnormal)

    def _sum(self, value: Array, error: Array, terms: Array, count: int) -> Bounded:
        """The value of a sum of `count` terms with its bounds: `error` is the sum of the terms'
        errors, `terms` that of their magnitudes. The error is infinite if a sum of the terms in
        another order may overflow.
        """
        value = value.astype(self._dtype, copy=False)
        # the negated comparison makes NaN unknown as well
        unknown = ~(terms + error < 0.5 * float(np.finfo(self._dtype).max))
        return Bounded(value, np.where(unknown, np.inf, error), terms, count)

    def _term(self, value: Array, error: Array) -> Bounded:
        """A value that is not a sum, with the maximum error `error` of each element."""
        return self._sum(value, error, np.abs(value).astype(float) + error, 1)

    def _product(self, values: Sequence[Array], spreads: Sequence[Array]) -> Bounded:
        a, b = (np.abs(value).astype(float) for value in values)
        s, r = spreads
        size = (a + s) * (b + r)
        # a subnormal result has an absolute rounding error; 0 has none
        rounded = self.unit * size + self._smallest * (size > 0)
        return self._term(values[0] * values[1], a * r + s * (b + r) + rounded)

    def _quotient(self, values: Sequence[Array], spreads: Sequence[Array]) -> Bounded:
        value = values[0] / values[1]
        s, r = spreads
        # minimum magnitude of the exact divisor; if it can be 0, the quotient is unbounded
        below = np.abs(values[1]) - r
        # |n/d − N/D| ≤ (|n − N| + |n/d|·|d − D|) / |D|
        off = (s + np.abs(value) * r) / below
        error = off + self.unit * (np.abs(value) + off) + self._smallest
        error = np.where((values[0] == 0) & (s == 0), 0.0, error)
        return self._term(value, np.where(below > 0, error, np.inf))

    def _contraction(self, meaning: Evaluator, args: Sequence[Bounded], length: int) -> Bounded:
        left, right = args
        a, b = (np.abs(one.value).astype(float) for one in (left, right))
        s, r = (one.spread(self.unit) for one in (left, right))
        value = meaning([left.value, right.value], NOWHERE)
        terms = meaning([a + s, b + r], NOWHERE)
        # |ab − AB| ≤ |a|·|b − B| + |a − A|·|B|, summed over the products
        off = meaning([a, r], NOWHERE) + meaning([s, b + r], NOWHERE)
        rounded = self.unit * terms + length * self._smallest * (terms > 0)
        return self._sum(value, off + rounded, terms, length)

    def _length(self, node: Node, axis: str) -> int:
        found = self._graph[node.args[0]].type.axis(axis)
        assert found is not None
        return found.size

    def _extreme(self, left: Bounded, right: Bounded, *, least: bool) -> Bounded:
        a, b = left.value, right.value
        # like the interpreter: a tie or NaN gives the first operand
        first = (a <= b if least else a >= b) | np.isnan(a)
        s, r = left.spread(self.unit), right.spread(self.unit)
        # the larger error counts where either operand may be selected
        apart = np.abs(a.astype(float) - b) > s + r
        error = np.where(apart, np.where(first, s, r), np.maximum(s, r))
        return chosen(np.where(first, a, b), error)

    def _applied(
        self, function: str, value: Array, values: Sequence[Array], spreads: Sequence[Array]
    ) -> Bounded:
        row = SCALAR_FUNCTIONS[function]
        off = _reach(row.numpy, values, spreads)
        # a few samples per period do not bound a periodic function
        if function in ("sin", "cos"):
            off = np.where(spreads[0] > _SHORT, 2.0, off)
        elif function == "tan":
            turns = [np.floor((values[0] + s) / np.pi + 0.5) for s in (-spreads[0], spreads[0])]
            off = np.where(turns[0] == turns[1], off, np.inf)
        # exact: these functions add no rounding
        if function in ("abs", "sign"):
            return self._term(value, off)
        size = np.abs(value) + off
        if row.kernel is None:  # one correctly rounded operation
            return self._term(value, off + self.unit * size)
        rounded = FUNCTION_ERROR[self._dtype.name] * size
        least = _SMALLEST_RESULT * float(np.finfo(self._dtype).tiny)
        return self._term(value, off + rounded + least)


def _reach(
    function: Callable[..., Array], values: Sequence[Array], spreads: Sequence[Array]
) -> Array:
    """Maximum change of `function` while each argument varies by at most its spread around its
    value; infinite if it leaves the domain of the function.

    It is twice the largest change at the ends and halves of the intervals and their corners. That
    is exact to first order; a monotone function is extreme at the ends.
    """
    shape = np.broadcast_shapes(*(value.shape for value in values))
    if not any(spread.any() for spread in spreads):
        return np.zeros(shape)
    centre = [value.astype(float) for value in values]
    here = function(*centre)
    largest = np.zeros(shape)
    for signs in product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=len(values)):
        # `if s` avoids 0·∞ = NaN at the centre of an unbounded argument
        moved = [c + s * r if s else c for c, s, r in zip(centre, signs, spreads, strict=True)]
        change = np.abs(function(*moved) - here)
        # an end outside the domain gives no bound
        largest = np.maximum(largest, np.where(np.isnan(change), np.inf, change))
    still = np.ones(shape, bool)
    for spread in spreads:
        still = still & (spread == 0)
    return np.where(still, 0.0, 2.0 * largest)


@dataclass(frozen=True, slots=True)
class Rollouts:
    """A batch of rollouts over the log: `steps` steps from each of the rows `t0`. Losses count from
    step `skip` on.
    """

    log: Mapping[str, Array]
    t0: NDArray[np.int64]
    steps: int
    skip: int


@dataclass(frozen=True, slots=True)
class RolloutStep:
    """The states before one step of all rollouts, by name, and the values of the step's nodes by
    node id.
    """

    states: dict[str, Bounded]
    values: list[Bounded]


class Forward:
    """Evaluates the start and the steps of a program with rounding bounds, including the nodes
    `wanted` of each step.
    """

    def __init__(
        self,
        program: Program,
        wanted: Sequence[NodeId],
        weights: Mapping[str, Array],
        dtype: np.dtype[Any],
    ) -> None:
        self._program = program

        def made(graph: Graph, nodes: Sequence[NodeId]) -> BoundedGraph:
            return BoundedGraph(graph, nodes, weights, dtype)

        self._start = made(program.start, [state.start for state in program.states])
        self._step = made(program.step, [*(state.next for state in program.states), *wanted])

    def moments(self, runs: Rollouts) -> list[RolloutStep]:
        """Runs the rollouts and returns one `RolloutStep` per step."""
        members = len(runs.t0)
        values = self._start.run(runs.log, runs.t0, {})
        states = {s.name: values[s.start].repeated(members) for s in self._program.states}
        steps: list[RolloutStep] = []
        for number in range(runs.steps):
            values = self._step.run(runs.log, runs.t0 + number, states)
            # stores all steps: the reverse pass needs the states before each of them
            steps.append(RolloutStep(states, values))
            states = {s.name: values[s.next].repeated(members) for s in self._program.states}
        return steps
