"""What the judge, the numpy interpreter, does along a record: states and outputs of every step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.ports.step_interface import Port, step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.agreement.record import Record
from msnn.data.dataset import FloatArray

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Judgement:
    """Arrays (steps, *shape) by the names of the spec; `states` are those before each step."""

    windows: Arrays
    """What the first states are made of: one window a signal, (*shape)."""
    window_firsts: Mapping[str, int]
    """The first sample in each of them, counted from the judge's first step."""
    inputs: Arrays
    states: Arrays
    outputs: Arrays
    next_states: Arrays

    def window(self, signal: str, first: int, length: int) -> NDArray[Any]:
        """As many samples of a signal from `first` on, (…, length): some backends need fewer."""
        begin = first - self.window_firsts[signal]
        return self.windows[signal][..., begin : begin + length]


def judge(
    program: Program, weights: Mapping[str, FloatArray], record: Record, dtype: DTypeLike
) -> Judgement:
    """A free run of the program in step form along the record, in float64 or float32."""
    interface = step_interface(program)
    log = {name: series.astype(dtype) for name, series in record.log.items()}
    interpreter = Interpreter(program, weights, dtype)
    current = interpreter.start(log, record.t0)
    states: list[Arrays] = []
    outputs: list[Arrays] = []
    nexts: list[Arrays] = []
    for t in range(record.t0, record.t0 + record.steps):
        values = interpreter.step(log, t, current, losses=False)
        states.append(dict(current))
        outputs.append(values.outputs)
        nexts.append(values.next_states)
        current = values.next_states
    rows = np.arange(record.t0, record.t0 + record.steps)
    return Judgement(
        windows={
            port.signal.name: window[0]
            for port, window in _samples(interface.start_windows, log, rows[:1])
        },
        window_firsts={port.signal.name: port.first for port in interface.start_windows},
        inputs={port.signal.name: s for port, s in _samples(interface.inputs, log, rows)},
        states=_joined(states),
        outputs=_joined(outputs),
        next_states=_joined(nexts),
    )


def _samples(
    ports: Sequence[Port], log: Mapping[str, NDArray[Any]], rows: NDArray[np.int64]
) -> list[tuple[Port, NDArray[Any]]]:
    """Each port's samples at every row, (rows, *shape of the port)."""
    found: list[tuple[Port, NDArray[Any]]] = []
    for port in ports:
        around = rows[:, None] + np.arange(port.first, port.last + 1)
        values = np.moveaxis(log[port.signal.name][around], 1, -1)
        found.append((port, values.reshape(len(rows), *port.type.shape)))
    return found


def _joined(steps: Sequence[Arrays]) -> Arrays:
    return {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}
