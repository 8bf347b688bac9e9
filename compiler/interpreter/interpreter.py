"""Runs a Program with numpy on a batch: the reference interpreter of all backends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from compiler.interpreter.operations import (
    NOWHERE,
    Array,
    Evaluator,
    LeafValues,
    evaluator,
    repeated_batch,
)
from compiler.ir.nodes import Extent, needed, states_beside_the_log
from compiler.ir.ops import ReadSamples, ReadState, Window
from compiler.ir.program import Graph, NodeId, Program

States = dict[str, Array]


@dataclass(frozen=True, slots=True)
class StepValues:
    """The results of one step for a batch of B members; every array of outputs, states and losses
    is (B, *shape).
    """

    outputs: dict[str, Array]
    next_states: States
    losses: dict[str, tuple[Array, Array | None]]
    """Prediction and target of each loss; empty if losses were not requested."""
    nodes: Sequence[Array | None]
    """Value of each computed node; the batch size is 1 if the value does not depend on the
    member."""


@dataclass(frozen=True, slots=True)
class Rollout:
    """The outputs of a rollout, arrays (B, steps, *shape) by name, and the states after its last
    step, (B, *shape).
    """

    outputs: dict[str, Array]
    states: States


class Interpreter:
    """A program with weights, ready to run over a log.

    The log has one array (rows, *shape) per signal. `t` are row numbers, one per member of the
    batch. `weights` are physical arrays by name; a missing one is the initial value of the
    parameter. With float32 every operation rounds to float32, and scalar functions are the math
    kernels. Raises ValueError for weights of a wrong shape, and for a dtype other than float32 and
    float64; IndexError for rows outside the log.
    """

    def __init__(
        self,
        program: Program,
        weights: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self.program = program
        self.dtype = np.dtype(dtype)
        if self.dtype not in (np.dtype(np.float32), np.dtype(np.float64)):
            message = f"the interpreter runs in float32 or float64, not {self.dtype}"
            raise ValueError(message)
        self.weights = physical_weights(program, weights or {})
        states = program.states
        following = {state.name: state.next for state in states}
        outputs = [output.node for output in program.outputs]
        beside = states_beside_the_log(program.step, following, outputs)
        # states that only losses depend on may read targets, which a simulation may lack
        self._simulated = {n: node for n, node in following.items() if n not in beside}
        self._outputs = outputs

    # each plan is built at its first use: a simulation needs no losses

    @cached_property
    def _start(self) -> _Plan:
        return self._prepared(self.program.start, [state.start for state in self.program.states])

    @cached_property
    def _simulate(self) -> _Plan:
        return self._prepared(self.program.step, [*self._outputs, *self._simulated.values()])

    @cached_property
    def _score(self) -> _Plan:
        following = [state.next for state in self.program.states]
        losses = [node for loss in self.program.losses for node in loss.nodes]
        return self._prepared(self.program.step, [*self._outputs, *following, *losses])

    def start(self, log: Mapping[str, Array], t0: ArrayLike) -> States:
        """The states before the first step, (B, *shape) by name, for rollouts that begin at the
        rows `t0` of the log. Raises IndexError if the start reads rows outside the log.
        """
        t = _rows(t0)
        values = self._start.run(LeafValues(log, t, {}))
        # copied, since the caller may write to one member of the batch
        return {
            state.name: repeated_batch(values[state.start], len(t)).copy()
            for state in self.program.states
        }

    def step(
        self,
        log: Mapping[str, Array],
        t: ArrayLike,
        states: Mapping[str, Array],
        *,
        losses: bool = True,
    ) -> StepValues:
        """Runs one step from `states`, member i at row t[i] of the log. Raises IndexError if it
        reads rows outside the log.

        Without `losses` the log needs no targets. States on which only losses depend and that read
        the log are then omitted.
        """
        rows = _rows(t)
        # two plans, so that a simulation never evaluates nodes that read targets
        plan = self._score if losses else self._simulate
        every = {state.name: state.next for state in self.program.states}
        following = every if losses else self._simulated
        values = plan.run(LeafValues(log, rows, self._cast(states)))
        return StepValues(
            {out.name: _value(values, out.node, rows) for out in self.program.outputs},
            {name: _value(values, node, rows) for name, node in following.items()},
            {
                loss.name: (
                    _value(values, loss.prediction, rows),
                    None if loss.target is None else _value(values, loss.target, rows),
                )
                for loss in self.program.losses
            }
            if losses
            else {},
            values,
        )

    def rollout(
        self,
        log: Mapping[str, Array],
        t0: ArrayLike,
        steps: int,
        states: Mapping[str, Array] | None = None,
    ) -> Rollout:
        """Runs `steps` steps, member i from row t0[i] on, and evaluates no losses. It begins with
        `states`, or with those of `start` if they are None. Raises IndexError if it reads rows
        outside the log.
        """
        t = _rows(t0)
        current: Mapping[str, Array] = self.start(log, t) if states is None else states
        types = {
            output.name: self.program.step[output.node].type for output in self.program.outputs
        }
        outputs = {
            name: np.empty((len(t), steps, *type.shape), self.dtype) for name, type in types.items()
        }
        for k in range(steps):
            values = self.step(log, t + k, current, losses=False)
            for name, value in values.outputs.items():
                outputs[name][:, k] = value
            # all states at once, after the step (R4)
            current = values.next_states
        # after 0 steps: the initial states, in the dtype of a step
        return Rollout(outputs, dict(self._cast(current)))

    def _prepared(self, graph: Graph, wanted: Iterable[NodeId]) -> _Plan:
        # building a plan evaluates constants; overflow gives inf without a warning
        with np.errstate(all="ignore"):
            return _Plan(graph, wanted, self.weights, self.dtype)

    def _cast(self, states: Mapping[str, Array]) -> Mapping[str, Array]:
        return {name: np.asarray(value, self.dtype) for name, value in states.items()}


def physical_weights(
    program: Program, weights: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.float64]]:
    """The float64 array of each parameter, by name; its initial value if `weights` lacks it. Raises
    ValueError for a wrong shape.
    """
    result: dict[str, NDArray[np.float64]] = {}
    for parameter in program.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        array = weights.get(parameter.name)
        if array is None:
            value = np.array(parameter.initial, np.float64).reshape(shape)
        else:
            value = np.array(array, np.float64)
            if value.shape != shape:
                message = f"weights of `{parameter.name}` have shape {value.shape}, not {shape}"
                raise ValueError(message)
        result[parameter.name] = value
    return result


class _Plan:
    """Computes the `wanted` nodes of a graph: one evaluator for each node that they depend on.
    Nodes without samples and states are evaluated once, in advance.
    """

    def __init__(
        self,
        graph: Graph,
        wanted: Iterable[NodeId],
        weights: Mapping[str, NDArray[np.float64]],
        dtype: np.dtype[Any],
    ) -> None:
        live = needed(graph, wanted)
        self._known: list[Any] = [None] * len(graph)
        self._steps: list[tuple[NodeId, Evaluator]] = []
        self._extents: dict[str, Extent] = {}
        # range of samples of each signal that nodes read, checked once per run
        for index, node in graph:
            if not live[index]:
                continue
            types = tuple(graph[arg].type for arg in node.args)
            evaluate = evaluator(node, types, weights, dtype)
            if isinstance(node.op, ReadSamples):
                extent = Extent(node.op.first, node.op.last)
                previous = self._extents.get(node.op.signal, extent)
                self._extents[node.op.signal] = previous.union(extent)
            # nodes that read samples or states change in each step; all others are evaluated once
            outside = isinstance(node.op, ReadSamples | ReadState | Window)
            if outside or any(self._known[arg] is None for arg in node.args):
                self._steps.append((index, evaluate))
            else:
                self._known[index] = evaluate(self._known, NOWHERE)

    def run(self, around: LeafValues) -> list[Array]:
        self._check_rows(around)
        values = self._known.copy()
        with np.errstate(all="ignore"):
            for index, evaluate in self._steps:
                values[index] = evaluate(values, around)
        return values

    def _check_rows(self, around: LeafValues) -> None:
        # numpy would read a negative row from the end of the log
        if not self._extents:
            return
        first, last = int(around.t.min()), int(around.t.max())
        for signal, extent in self._extents.items():
            rows = len(around.log[signal])
            if first + extent.first < 0 or last + extent.last >= rows:
                message = (
                    f"`{signal}` has rows 0 … {rows - 1} in the log, the step at rows {first} … "
                    f"{last} reads {first + extent.first} … {last + extent.last}"
                )
                raise IndexError(message)


def _rows(t: ArrayLike) -> NDArray[np.int64]:
    return np.atleast_1d(np.asarray(t, np.int64))


def _value(values: Sequence[Array], node: NodeId, rows: NDArray[np.int64]) -> Array:
    return repeated_batch(values[node], len(rows))
