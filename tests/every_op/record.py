"""What a record of `test_every_op` holds: a tiny program, samples, and what numpy says of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import (
    Declared,
    Graph,
    NodeId,
    Origin,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
)
from compiler.ir.types import WINDOW, Axis, Type

Array = NDArray[np.float64]

SMOOTH_ROWS = 12
"""The first rows of every log: random samples away from kinks, where gradients are compared."""

WINDOW_LENGTH = 4


@dataclass(frozen=True)
class Record:
    """One op: expectations are arrays (times, *shape), computed without the compiler."""

    name: str
    program: Program
    log: dict[str, Array]
    expected: dict[str, Array]
    expected_next: dict[str, Array]

    @property
    def times(self) -> NDArray[np.int64]:
        """Rows at which the step runs: those with a whole window before them."""
        rows = min(len(series) for series in self.log.values())
        return np.arange(WINDOW_LENGTH - 1, rows - 1)

    @property
    def smooth_times(self) -> NDArray[np.int64]:
        return self.times[self.times < SMOOTH_ROWS - 1]


class RecordBuilder:
    """Grows the program of a record beside its log and expectations."""

    def __init__(self) -> None:
        self.graph = GraphBuilder()
        self.starts = GraphBuilder()
        self._signals: list[Signal] = []
        self._parameters: list[Parameter] = []
        self._states: list[State] = []
        self._outputs: list[Output] = []
        self._log: dict[str, Array] = {}
        self._expected: dict[str, Array] = {}
        self._expected_next: dict[str, Array] = {}

    def series(self, name: str, values: ArrayLike, axes: tuple[Axis, ...] = ()) -> Array:
        """Declares an input with this log (rows, *shape)."""
        array = np.asarray(values, np.float64)
        # what float32 cannot hold would be an error of the samples, not of a backend
        array = array.astype(np.float32).astype(np.float64)
        self._signals.append(Signal(name, Role.INPUT, axes, on_invalid="trust"))
        self._log[name] = array
        return array

    def sample(self, name: str, values: ArrayLike, axes: tuple[Axis, ...] = ()) -> NodeId:
        """The current sample of a new input."""
        self.series(name, values, axes)
        return self.graph.signal(name, 0, 0, Type(axes))

    def past(self, name: str) -> NodeId:
        """The last samples of an input."""
        axes = next(signal.axes for signal in self._signals if signal.name == name)
        type = Type((*axes, Axis(WINDOW, WINDOW_LENGTH)))
        return self.graph.signal(name, 1 - WINDOW_LENGTH, 0, type)

    def logged(self, name: str) -> Array:
        """The series of an input as float32 holds it."""
        return self._log[name]

    def parameter(self, name: str, values: ArrayLike, axes: tuple[Axis, ...] = ()) -> NodeId:
        flat = tuple(np.asarray(values, np.float64).ravel().tolist())
        self._parameters.append(Parameter(name, axes, initial=flat))
        return self.graph.parameter(name, Type(axes))

    def state(
        self,
        name: str,
        axes: tuple[Axis, ...],
        next: NodeId,
        start: NodeId,
        origin: Origin | None = None,
    ) -> None:
        """Declares a state; `start` is a node of `starts`."""
        self._states.append(State(name, axes, None, origin or Declared(), next, start))

    def expect(self, output: str, node: NodeId, values: ArrayLike) -> None:
        """An output whose values (rows, *shape), one for each row of the log, numpy knows."""
        self._outputs.append(Output(output, node))
        self._expected[output] = np.asarray(values, np.float64)

    def expect_next(self, state: str, values: ArrayLike) -> None:
        self._expected_next[state] = np.asarray(values, np.float64)

    def record(self, name: str) -> Record:
        program = Program(
            name=name,
            sample_time=0.1,
            signals=tuple(self._signals),
            parameters=tuple(self._parameters),
            states=tuple(self._states),
            step=self.graph.graph(),
            start=self.starts.graph(),
            outputs=tuple(self._outputs),
        )
        record = Record(name, program, self._log, {}, {})
        for wanted, given in (
            (record.expected, self._expected),
            (record.expected_next, self._expected_next),
        ):
            wanted.update({key: values[record.times] for key, values in given.items()})
        return record


def ops_of(graph: Graph) -> set[type]:
    """The operations that a graph has."""
    return {type(node.op) for node in graph.nodes}


def windows_of(series: Array, first: int, last: int) -> Array:
    """Samples t+first … t+last for every row t, the window last; NaN where there are none."""
    padded = np.full((len(series), *series.shape[1:], last - first + 1), np.nan)
    for row in range(len(series)):
        for place, offset in enumerate(range(first, last + 1)):
            if 0 <= row + offset < len(series):
                padded[row, ..., place] = series[row + offset]
    return padded
