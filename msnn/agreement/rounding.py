"""Determines the effect of rounding: errors of single steps, and conditions that it decides."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.bounded import Bounded, Taken, exact
from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Graph, NodeId, Program
from msnn.agreement.agreement import Fault, NoChoice
from msnn.agreement.judgement import (
    AgreementRecord,
    Arrays,
    FloatType,
    Judgement,
    labelled,
    labelled_first,
)
from msnn.agreement.subject import Subject
from msnn.data.dataset import FloatArray

STEP_LIMIT = {"float64": 1e-12, "float32": 1e-5}
"""Tolerance of one step from reference states, in the arithmetic of the target."""

ORDERS = 16.0
"""Factor between rounding errors of another order of operations and those of the interpreter.

Any order of n operations has an error of at most n ε Σ|terms|. The maximum over hundreds of steps
comes close to √n of it; 16 covers sums of 256 terms.
"""


def single_steps(
    program: Program, weights: Mapping[str, FloatArray], record: AgreementRecord, wanted: Judgement
) -> dict[str, Arrays]:
    """Outputs and next states of the interpreter in float32, each step from the reference state."""
    # states are those of float64, rounded: a step is compared, not the way to it
    log = {name: series.astype(np.float32) for name, series in record.log.items()}
    states = {name: values.astype(np.float32) for name, values in wanted.states.items()}
    rows = record.t0 + np.arange(record.steps)
    with np.errstate(all="ignore"):  # what overflows in single precision is seen in its values
        values = Interpreter(program, weights, np.float32).step(log, rows, states, losses=False)
    shape = (record.steps,)
    return {
        "outputs": {n: np.broadcast_to(v, shape + v.shape[1:]) for n, v in values.outputs.items()},
        "next_states": {
            n: np.broadcast_to(v, shape + v.shape[1:]) for n, v in values.next_states.items()
        },
    }


def first_states(
    program: Program, weights: Mapping[str, FloatArray], record: AgreementRecord
) -> Arrays:
    """Initial states of the interpreter in float32, (1, *shape) each."""
    log = {name: series.astype(np.float32) for name, series in record.log.items()}
    with np.errstate(all="ignore"):
        return Interpreter(program, weights, np.float32).start(log, record.t0)


def within_rounding(
    program: Program,
    weights: Mapping[str, FloatArray],
    record: AgreementRecord,
    wanted: Judgement,
    found: Arrays,
) -> dict[str, NDArray[np.bool_]]:
    """Masks of values whose difference from the reference is within the rounding bound of float64.

    Every value has its own bound (decision 0180): a difference of nearly equal numbers is small,
    although its rounding error depends on their size. Also marks the steps without a bound, which
    are not compared.
    """
    steps = labelled(
        {output.name: output.node for output in program.outputs},
        {state.name: state.next for state in program.states},
    )
    firsts = labelled_first({state.name: state.start for state in program.states})
    begin, rows = np.array([record.t0]), record.t0 + np.arange(record.steps)
    states = {name: exact(values) for name, values in wanted.states.items()}
    judged = labelled(wanted.outputs, wanted.next_states) | labelled_first(wanted.states)
    physical = physical_weights(program, weights)
    inside: dict[str, NDArray[np.bool_]] = {}
    for graph, nodes, t, leaves in (
        (program.start, firsts, begin, {}),
        (program.step, steps, rows, states),
    ):
        named = {name: node for name, node in nodes.items() if name in found}
        bounds = BoundedGraph(graph, named.values(), physical, np.dtype(np.float64))
        values = bounds.run(record.log, t, leaves)
        for name, node in named.items():
            of_judge = judged[name][: len(found[name])]
            # both are within the spread of the exact value
            spread = np.broadcast_to(2.0 * values[node].spread(bounds.unit), of_judge.shape)
            apart = np.abs(found[name] - of_judge)
            # all of a value, or none: a value of which one step is too far has a fault
            if np.all(apart <= spread):
                # an infinite bound lets anything pass: there nothing was compared
                unbounded = (np.isinf(spread) & (apart > 0)).reshape(len(spread), -1)
                inside[name] = np.any(unbounded, axis=1)
    return inside


def step_limit(dtype: str, rounding: float) -> float:
    """The tolerance of a value with this rounding error in single precision.

    Rounding errors scale with the precision, whatever amplifies them: a difference of close
    numbers, or a division by a short sample time.
    """
    # errors of rounding scale with the precision
    share = float(np.finfo(dtype).eps) / float(np.finfo(np.float32).eps)
    return max(STEP_LIMIT[dtype], ORDERS * rounding * share if np.isfinite(rounding) else 0.0)


MOST_WAYS = 64
"""Maximum number of combinations of undecided conditions per step."""
_BLOCK = 256
"""Number of steps evaluated in parallel."""

_Way: TypeAlias = dict[tuple[NodeId, int], float]
"""Outcome of elements of conditions, by node and index in C order."""


@dataclass(frozen=True, slots=True)
class OpenDecision:
    """The values of a step, (*shape) by name, for one combination of branches.

    Rounding decides the conditions of these branches. `spreads` are the rounding bounds of the
    values.
    """

    step: int
    values: Arrays
    spreads: Arrays
    """Maximum difference to another program in the same arithmetic."""


@dataclass(frozen=True, slots=True)
class Undecided:
    """The steps at which rounding decides conditions, with the values of all combinations of
    branches.
    """

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
        """Those of the steps at which rounding may change a condition, in other programs or the
        reference.
        """
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


@dataclass(frozen=True, slots=True)
class Branches:
    """The steps at which rounding may select either of several branches that differ.

    There a value must match one of the branches; it is not compared otherwise.
    """

    at: Mapping[str, NDArray[np.bool_]]
    """Masks (steps,) by names of values in messages; an initial state has one step."""
    faults: tuple[Fault, ...]
    """Values that match no branch."""

    def settled(self, found: Arrays, judged: Arrays) -> dict[str, NDArray[Any]]:
        """The values with the reference's at these steps, so that only the others are compared."""
        settled = dict(found)
        for name, where in self.at.items():
            if where.any():
                settled[name] = np.array(found[name])
                settled[name][where] = judged[name][: len(where)][where]
        return settled

    @property
    def counts(self) -> dict[str, int]:
        """Number of these steps per value, where it is not 0."""
        return {name: int(where.sum()) for name, where in self.at.items() if where.any()}

    @property
    def untried(self) -> tuple[str, ...]:
        """Values with these steps only, so that no step was compared."""
        return tuple(name for name, where in self.at.items() if where.all())


def branches(
    subject: Subject, dtype: FloatType, record: AgreementRecord, wanted: Judgement, found: Arrays
) -> Branches:
    """Compares each step with an undecided condition with the results of its branches.

    If all branches agree within rounding, the step is compared normally: near the threshold of
    `where(x > 0, x, 0)` both are equal. Other steps are counted; their values must match one branch
    within rounding.
    """
    program = subject.program
    weights = physical_weights(program, subject.weights)
    # values are compared under the names that messages give them: outputs and states may share one
    judged = labelled(wanted.outputs, wanted.next_states) | labelled_first(wanted.states)
    steps = Steps(
        graph=program.step,
        nodes=labelled(
            {output.name: output.node for output in program.outputs},
            {state.name: state.next for state in program.states},
        ),
        weights=weights,
        log=record.log,
        rows=record.t0 + np.arange(record.steps),
        states=wanted.states,
    )
    firsts = Steps(
        graph=program.start,
        nodes=labelled_first({state.name: state.start for state in program.states}),
        weights=weights,
        log=record.log,
        rows=np.array([record.t0]),
        states={},
    )
    at: dict[str, NDArray[np.bool_]] = {}
    faults: list[Fault] = []
    for given in (steps, firsts):
        left_open = undecided(given, dtype)
        # first states are judged like steps: their graph has conditions too
        for name in given.nodes:
            value = _Value(name, judged[name], found[name], STEP_LIMIT[dtype])
            where = np.zeros(len(given.rows), bool)
            # steps that leave more open than is tried are compared with nothing, and counted
            where[list(left_open.vast)] = True
            by_step: dict[int, list[OpenDecision]] = {}
            for choice in left_open.choices:
                by_step.setdefault(choice.step, []).append(choice)
            for step, choices in by_step.items():
                # with all choices near to the judge there is no decision of rounding to speak of
                where[step] = not all(value.is_judged(choice) for choice in choices)
                fault = value.fault(choices) if where[step] else None
                if fault is not None:
                    faults.append(fault)
            at[name] = where
    return Branches(at, _worst(faults))


@dataclass(frozen=True, slots=True)
class _Value:
    name: str
    judged: NDArray[Any]
    found: NDArray[Any]
    granted: float
    """Tolerance relative to the largest magnitude."""

    @property
    def scale(self) -> float:
        # relative to the largest of the record: a value that is 0 now has no size
        finite = np.abs(self.judged[np.isfinite(self.judged)])
        return float(finite.max(initial=0.0))

    def is_judged(self, choice: OpenDecision) -> bool:
        """True if a branch agrees with the reference within rounding."""
        return self._excess(choice, self.judged[choice.step]) <= 0.0

    def fault(self, choices: list[OpenDecision]) -> Fault | None:
        """The fault if the value matches no branch at its step."""
        step = choices[0].step
        if any(self._excess(choice, self.found[step]) <= 0.0 for choice in choices):
            return None
        nearest = min(_distance(choice.values[self.name], self.found[step]) for choice in choices)
        return NoChoice(self.name, step, nearest)

    def _excess(self, choice: OpenDecision, value: NDArray[Any]) -> float:
        """The difference between a value and a branch, minus the bound of rounding."""
        mine = choice.values[self.name].astype(float)
        # both are within the spread of the exact value
        room = np.maximum(2.0 * choice.spreads[self.name], self.granted * self.scale)
        same = (mine == value) | (np.isnan(mine) & np.isnan(value)) | (room == math.inf)
        excess = np.where(same, 0.0, np.abs(mine - value) - room)
        return float(np.where(np.isnan(excess), math.inf, excess).max(initial=0.0))


def _distance(left: NDArray[Any], right: NDArray[Any]) -> float:
    error = np.abs(left.astype(float) - right)
    return float(np.where(np.isnan(error), math.inf, error).max(initial=0.0))


def _worst(faults: list[Fault]) -> tuple[Fault, ...]:
    """The fault with the largest error for each value."""
    found: dict[str, Fault] = {}
    for fault in faults:
        assert isinstance(fault, NoChoice)
        known = found.get(fault.of)
        if not isinstance(known, NoChoice) or fault.error > known.error:
            found[fault.of] = fault
    return tuple(found.values())
