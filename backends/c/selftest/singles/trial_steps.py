"""Runs many single steps at once, from starts of golden runs with some values overwritten."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import InputField, Interface
from backends.c.selftest.golden_vectors import GoldenStart, state_fields
from backends.c.selftest.reference_step import log_of_steps, with_checked
from backends.c.selftest.singles.changed_operands import Change, ChangeableGraph
from compiler.interpreter.operations import LeafValues, repeated_batch
from compiler.ir.program import NodeId, Program, State

Array = NDArray[Any]

_ROWS, _NUMBERS = 8192, 16_000_000
"""Maximum number of changed steps computed at once, and of values stored for them."""
_TUNABLE = 512
"""Maximum number of parameter elements for which steps change parameters, since each step has its
own copy."""


@dataclass(frozen=True, slots=True)
class Trials:
    """B single steps: for each the index of its start, and a row of values that overwrite it. A row
    has written states, then inputs, then changeable parameters; `TrialSteps` knows their positions.
    """

    starts: NDArray[np.int64]
    """Index of the start of each step."""
    numbers: Array
    """Values of written states, inputs and parameters, (B, size)."""

    def of(self, rows: Array) -> Trials:
        """The steps with these indices, or those at which a mask is True."""
        return Trials(self.starts[rows], self.numbers[rows])

    def __len__(self) -> int:
        return len(self.starts)


def joined_trials(parts: Iterable[Trials]) -> Trials:
    """The steps of all parts, one after the other."""
    every = [*parts]
    return Trials(
        np.concatenate([part.starts for part in every]),
        np.concatenate([part.numbers for part in every]),
    )


@dataclass(frozen=True, slots=True)
class TrialValues:
    """The results of B steps; each value is computed when it is first read."""

    program: Program
    count: int
    """Number of steps."""
    nodes: Mapping[NodeId, Array]
    """Values of the nodes of the step, (B, …) or (1, …)."""
    slopes: Mapping[NodeId, Array]
    """Values of the nodes of the Jacobian, (B, …) or (1, …); empty without a Jacobian."""

    @property
    def outputs(self) -> dict[str, Array]:
        """Outputs by name, (B, …)."""
        outputs = self.program.outputs
        return {out.name: repeated_batch(self.nodes[out.node], self.count) for out in outputs}

    @property
    def next_states(self) -> dict[str, Array]:
        """Next states by name, (B, …)."""
        return {state.name: self.next_state(state.name) for state in self.program.states}

    def next_state(self, name: str) -> Array:
        """The next values of one state, (B, …)."""
        return repeated_batch(self.nodes[self.program.state(name).next], self.count)


class TrialSteps:
    """A program prepared for computing many single steps at once, and the positions of states,
    inputs and parameters in a row of `Trials.numbers`. `starts` are golden starts, from which steps
    begin.
    """

    def __init__(
        self,
        program: Program,
        interface: Interface,
        weights: Mapping[str, Array],
        starts: Sequence[GoldenStart],
    ) -> None:
        self.program, self.interface = with_checked(program), interface
        self._given = program, weights, starts
        self.dtype = np.dtype(interface.options.dtype)
        self.starts = len(starts)
        self._begun = {
            state.name: np.concatenate([start.states[state.name] for start in starts])
            for state in program.states
        }
        self._places: dict[str, tuple[slice, tuple[int, ...]]] = {}
        first = 0
        shapes = [(field.name, field.shape) for field in state_fields(interface)]
        self.written_names = [name for name, _ in shapes]
        for name, shape in [*shapes, *((i.field.name, i.field.shape) for i in interface.inputs)]:
            self._places[name] = slice(first, first + math.prod(shape)), shape
            first += math.prod(shape)
        # numbers in the code cannot be other ones than trained
        tuned = interface.parameters if interface.takes_parameters else ()
        self._tuned = tuned if sum(f.size for f in tuned) <= _TUNABLE else ()
        for field in self._tuned:
            self._places[field.name] = slice(first, first + field.size), field.shape
            first += field.size
        self.size = first
        with np.errstate(over="ignore"):  # beyond float32 a weight is infinite, as in C
            trained = [np.asarray(weights[f.name]).astype(self.dtype).ravel() for f in self._tuned]
        self.trained = np.concatenate([np.zeros(0, self.dtype), *trained])
        """The trained values of the parameters that steps may change, in the order of their
        struct."""
        self.bounds = self._bounds_of_tuned()
        """Lower and upper bounds of these parameters. They keep the sign that the model requires,
        since knot distances must be positive. The magnitude is free, also beyond the limits of
        training."""
        jacobian = interface.jacobian.jacobian if interface.jacobian else None
        self._matrices = jacobian.matrices if jacobian else ()
        asked = [output.node for output in self.program.outputs]
        asked += [state.next for state in program.states]
        self._whole = ChangeableGraph(program.step, asked, weights, self.dtype)
        # a change shows in what is compared after one step
        self._shown: list[tuple[ChangeableGraph, list[NodeId]]] = []
        outputs = [output.node for output in program.outputs]
        compared = {*self.written_names}
        left = [state.next for state in self.program.states if state.name in compared]
        # what is an output too is compared after any step
        self._left = {*left} - {*outputs}
        graphs = [(self.program.step, [*outputs, *left])]
        if jacobian:
            graphs.append((jacobian.graph, jacobian.roots))
        for graph, roots in graphs:
            changeable = ChangeableGraph(graph, roots, weights, self.dtype)
            self._shown.append((changeable, [*dict.fromkeys(roots)]))

    def in_float64(self) -> TrialSteps:
        """The same program and starts, computed in float64."""
        program, weights, starts = self._given
        # it tells how far a step is from its aim, not what the C answers
        options = replace(self.interface.options, dtype="float64")
        return TrialSteps(program, replace(self.interface, options=options), weights, starts)

    @property
    def computed(self) -> int:
        """The number of elements that one step and its Jacobian compute."""
        return sum(graph.size for graph, _ in self._shown)

    def members(self) -> Iterator[tuple[State | InputField, slice]]:
        """The written states and the inputs, each with its positions in a row of
        `Trials.numbers`.
        """
        states = {state.name: state for state in self.program.states}
        inputs = {input.field.name: input for input in self.interface.inputs}
        for name in [*self.written_names, *inputs]:
            yield inputs[name] if name in inputs else states[name], self._places[name][0]

    @property
    def tuned(self) -> slice:
        """The positions of the changeable parameters in a row of `Trials.numbers`."""
        return slice(self.size - len(self.trained), self.size)

    def _bounds_of_tuned(self) -> tuple[Array, Array]:
        low, high = np.full(len(self.trained), -np.inf), np.full(len(self.trained), np.inf)
        first = 0
        for field in self._tuned:
            places = slice(first, first + field.size)
            parameter = self.program.parameter(field.name)
            if parameter.minimum is not None and parameter.minimum >= 0:
                low[places] = 0.0
            if parameter.maximum is not None and parameter.maximum <= 0:
                high[places] = 0.0
            first += field.size
        return low, high

    def inputs(self, trials: Trials) -> dict[str, Array]:
        """The inputs of the trials by name, (B, *shape)."""
        return {i.field.name: self._part(trials, i.field.name) for i in self.interface.inputs}

    def written(self, trials: Trials) -> dict[str, Array]:
        """The states of the trials that the test program writes before the step, by name, (B,
        *shape).
        """
        return {name: self._part(trials, name) for name in self.written_names}

    def begun(self, trials: Trials) -> dict[str, Array]:
        """The states after `reset` with the start of each trial, by name, (B, *shape); without the
        written values.
        """
        return {name: values[trials.starts] for name, values in self._begun.items()}

    def run(self, trials: Trials) -> TrialValues:
        """The interpreter's results of the steps. Input policies are not applied."""
        around, parameters = self._around(trials), self._parameters(trials)
        return TrialValues(
            program=self.program,
            count=len(trials),
            nodes=self._whole.run(around, parameters),
            slopes=self._shown[1][0].run(around, parameters) if self._matrices else {},
        )

    def matrices(self, trials: Trials) -> dict[str, Array]:
        """The matrices of the Jacobian at each step by name, (B, rows, columns); empty without a
        Jacobian.
        """
        count, nodes = len(trials), self.run(trials).slopes
        return {
            matrix.name: matrix.filled(
                {n: repeated_batch(nodes[n], count) for n in matrix.nodes}, count, self.dtype
            )
            for matrix in self._matrices
        }

    def with_trained(self, trials: Trials) -> Trials:
        """A copy of the steps in which all parameters have their trained values."""
        numbers = trials.numbers.copy()
        # a copy above: trials are shared between searches
        numbers[:, self.tuned] = self.trained
        return Trials(trials.starts, numbers)

    def changes(self) -> list[tuple[int, Change]]:
        """Every change of an operand that is tried, each with 0 for the graph of the step or 1 for
        the Jacobian.
        """
        return [(g, c) for g, (graph, _) in enumerate(self._shown) for c in graph.changes()]

    def seen(
        self, trials: Trials, changes: Sequence[tuple[int, Change]], *, states: bool = True
    ) -> NDArray[np.bool_]:
        """A mask (B, changes): True where the results of a step with the change (an element of
        `changes`) differ from the correct ones. Without `states`, only outputs and the Jacobian are
        compared, as after each step of a golden run.
        """
        count = len(trials)
        found = np.zeros((count, len(changes)), np.bool_)
        if not count:  # no step's bits are promised, as weights may be infinite in single precision
            return found
        for number, (graph, roots) in enumerate(self._shown):
            own = [k for k, (g, _) in enumerate(changes) if g == number]
            if not own:
                continue
            right = graph.run(self._around(trials), self._parameters(trials))
            # many changes at once as members of one batch, as many as fit the memory
            each = max(1, min(_ROWS, _NUMBERS // graph.size) // count)
            for begin in range(0, len(own), each):
                part = own[begin : begin + each]
                # copy i · count + b is trial b with change i of this part
                copies = np.tile(np.arange(count), len(part))
                wrong = graph.with_changes(
                    right,
                    copies,
                    self._around(trials.of(copies)),
                    {changes[k][1]: np.arange(count) + i * count for i, k in enumerate(part)},
                )
                differ = np.zeros(len(copies), np.bool_)
                for root in roots:
                    if number == 0 and not states and root in self._left:
                        continue
                    expected = repeated_batch(right[root], count).reshape(count, -1)
                    given = repeated_batch(wrong[root], len(copies)).reshape(len(copies), -1)
                    differ |= _differ(given, np.tile(expected, (len(part), 1))).any(axis=1)
                found[:, part] = differ.reshape(len(part), count).T
        return found

    def _part(self, trials: Trials, name: str) -> Array:
        places, shape = self._places[name]
        return trials.numbers[:, places].reshape(len(trials), *shape)

    def _around(self, trials: Trials) -> LeafValues:
        log, t = log_of_steps(self.interface, self.inputs(trials), len(trials))
        return LeafValues(log, t, self.begun(trials) | self.written(trials))

    def _parameters(self, trials: Trials) -> dict[str, Array]:
        """The parameters by name that differ from the trained ones in at least one step, (B,
        *shape).
        """
        found = {field.name: self._part(trials, field.name) for field in self._tuned}
        # parameters that no trial changes stay one array for the whole batch
        other = np.any(trials.numbers[:, self.tuned] != self.trained, axis=0)
        first = self.tuned.start
        return {
            name: values
            for name, values in found.items()
            if other[self._places[name][0].start - first : self._places[name][0].stop - first].any()
        }


def _differ(given: Array, expected: Array) -> NDArray[np.bool_]:
    # NaN is unequal to itself, and the right answer where the model says so
    return (given != expected) & ~(np.isnan(given) & np.isnan(expected))
