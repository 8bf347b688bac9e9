"""Finds steps at which rounding decides a condition, and the result of each branch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.bounded import Bounded, Taken, exact
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Graph, NodeId
from msnn.agreement.judging.judgement import Arrays, FloatType

MOST_WAYS = 64
"""Maximum number of combinations of undecided conditions per step."""
_BLOCK = 256
"""Number of steps evaluated in parallel."""

_Way: TypeAlias = dict[tuple[NodeId, int], float]
"""Outcome of elements of conditions, by node and index in C order."""


@dataclass(frozen=True, slots=True)
class OpenDecision:
    """The values of one combination of branches at a step, (*shape) by name."""

    step: int
    values: Arrays
    spreads: Arrays
    """Maximum difference to another program in the same arithmetic."""


@dataclass(frozen=True, slots=True)
class Undecided:
    """All combinations of branches that rounding leaves open, with their values."""

    choices: tuple[OpenDecision, ...]
    vast: frozenset[int]
    """Steps with too many combinations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """A graph evaluated at rows of a log from given states (steps, *shape), and its named
    values.
    """

    graph: Graph
    nodes: Mapping[str, NodeId]
    weights: Arrays
    log: Arrays
    rows: NDArray[np.int64]
    states: Arrays


def undecided(given: Steps, dtype: FloatType) -> Undecided:
    """All combinations at steps where a condition is undecided in float64 or float32.

    A condition is undecided if the rounding error of its operands may change it. It is also
    undecided if rounded inputs change it compared with float64.
    """
    own = _Evaluation(given, dtype)
    choices: list[OpenDecision] = []
    vast: set[int] = set()
    if own.decisions:
        judge = own if dtype == "float64" else _Evaluation(given, "float64")
        # in blocks, as memory grows with steps times nodes
        for begin in range(0, len(given.rows), _BLOCK):
            block = list(range(begin, min(begin + _BLOCK, len(given.rows))))
            doubtful = own.doubtful(block, judge)
            choices += own.choices(doubtful, vast)
    return Undecided(tuple(choices), frozenset(vast))


class _Evaluation:
    """Evaluates the graph of `Steps` in float32 or float64, with bounds on rounding errors.

    It finds the steps at which rounding may decide a condition, and the values of every branch.
    """

    def __init__(self, given: Steps, dtype: FloatType) -> None:
        kind = np.dtype(dtype)
        self._given = given
        self._log = {name: series.astype(kind) for name, series in given.log.items()}
        self._states = {name: values.astype(kind) for name, values in given.states.items()}
        self._bounds = BoundedGraph(given.graph, given.nodes.values(), given.weights, kind)
        self.decisions = self._bounds.decisions

    def doubtful(self, steps: Sequence[int], judge: _Evaluation) -> list[int]:
        """The steps at which other programs, or the reference, may decide differently."""
        values = self._run(steps, [{} for _ in steps])
        judged = values if judge is self else judge._run(steps, [{} for _ in steps])
        found = np.zeros(len(steps), bool)
        for node in self.decisions:
            # open by rounding, or decided otherwise since inputs were rounded
            differs = (values[node].error > 0) | (values[node].value != judged[node].value)
            found |= differs.reshape(len(differs), -1).any(axis=1)
        return [step for step, is_doubtful in zip(steps, found, strict=True) if is_doubtful]

    def choices(self, steps: Sequence[int], vast: set[int]) -> list[OpenDecision]:
        """Every combination of branches at the steps; steps with too many are added to `vast`."""
        found: list[OpenDecision] = []
        pending: list[tuple[int, _Way]] = [(step, {}) for step in steps]
        while pending:
            at = [step for step, _ in pending]
            values = self._run(at, [way for _, way in pending])
            doubts = {node: self._doubts(node, values[node], len(at)) for node in self.decisions}
            following: list[tuple[int, _Way]] = []
            for place, (step, way) in enumerate(pending):
                # one condition after the other: what a choice leads to may decide the next
                node = next((n for n, doubt in doubts.items() if doubt[place].any()), None)
                if node is None:
                    found.append(self._choice(step, values, place))
                    continue
                elements = np.flatnonzero(doubts[node][place]).tolist()
                # 2ⁿ ways of n elements
                if len(elements) > MOST_WAYS.bit_length():
                    vast.add(step)
                    continue
                keys = [(node, element) for element in elements]
                for options in product(self.decisions[node], repeat=len(elements)):
                    following.append((step, way | dict(zip(keys, options, strict=True))))
            counts = Counter(step for step, _ in following)
            vast.update(step for step, count in counts.items() if count > MOST_WAYS)
            pending = [one for one in following if one[0] not in vast]
        return [choice for choice in found if choice.step not in vast]

    def _run(self, steps: Sequence[int], ways: Sequence[_Way]) -> list[Bounded]:
        at = np.array(steps, np.int64)
        states = {name: exact(values[at]) for name, values in self._states.items()}
        rows, taken = self._given.rows[at], self._taken(ways)
        return self._bounds.run(self._log, rows, states, taken=taken)

    def _taken(self, ways: Sequence[_Way]) -> dict[NodeId, Taken]:
        found: dict[NodeId, Taken] = {}
        for place, way in enumerate(ways):
            for (node, element), value in way.items():
                shape = (len(ways), *self._given.graph[node].type.shape)
                taken = found.setdefault(node, Taken(np.zeros(shape, bool), np.zeros(shape)))
                taken.where.reshape(len(ways), -1)[place, element] = True
                taken.value.reshape(len(ways), -1)[place, element] = value
        return found

    def _doubts(self, node: NodeId, decision: Bounded, count: int) -> NDArray[np.bool_]:
        """Mask of undecided elements, (steps, elements)."""
        shape = (count, *self._given.graph[node].type.shape)
        return np.broadcast_to(decision.error > 0, shape).reshape(count, -1)

    def _choice(self, step: int, values: Sequence[Bounded], place: int) -> OpenDecision:
        # what no data enter has one row for all
        def at(array: NDArray[Any]) -> NDArray[Any]:
            return array[place if len(array) > 1 else 0]

        bounded = {name: values[node] for name, node in self._given.nodes.items()}
        return OpenDecision(
            step,
            {name: at(one.value) for name, one in bounded.items()},
            {name: at(one.spread(self._bounds.unit)) for name, one in bounded.items()},
        )
