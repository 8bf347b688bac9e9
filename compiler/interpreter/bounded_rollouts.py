"""Runs a program over rollouts and stores each step with bounds on its rounding error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.bounded import Bounded
from compiler.interpreter.operations import Array
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Graph, NodeId, Program


@dataclass(frozen=True, slots=True)
class Rollouts:
    """A batch of rollouts: `steps` steps from each of the rows `t0`; losses count from step
    `skip`.
    """

    log: Mapping[str, Array]
    t0: NDArray[np.int64]
    steps: int
    skip: int


@dataclass(frozen=True, slots=True)
class RolloutStep:
    """The states before one step of all rollouts, and the values of the nodes of the step."""

    states: dict[str, Bounded]
    values: list[Bounded]


class Forward:
    """Evaluates the start and the step of a program, with the requested nodes of each step."""

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
        """Returns every step of the rollouts."""
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
