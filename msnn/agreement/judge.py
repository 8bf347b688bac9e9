"""Runs the numpy reference interpreter on recorded inputs: states and outputs of every step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.ports.step_interface import Port, StepInterface, step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.agreement.judgement import AgreementRecord, Arrays, Beginning, Judgement
from msnn.data.dataset import FloatArray


def judge(
    program: Program,
    weights: Mapping[str, FloatArray],
    record: AgreementRecord,
    dtype: DTypeLike,
    *,
    restarts: bool = False,
) -> Judgement:
    """Simulates the program in step form over recorded inputs, in float64 or float32.

    The result is the reference for exports. With `restarts`, states with `on_range: reset` are
    reset as in deployed code.
    """
    interface = step_interface(program)
    log = {name: series.astype(dtype) for name, series in record.log.items()}
    interpreter = Interpreter(program, weights, dtype)
    current = begun = interpreter.start(log, record.t0)
    states: list[Arrays] = []
    outputs: list[Arrays] = []
    nexts: list[Arrays] = []
    restarted: list[Arrays] = []
    # one step after the other: a free run feeds on its own states
    for t in range(record.t0, record.t0 + record.steps):
        values = interpreter.step(log, t, current, losses=False)
        states.append(dict(current))
        outputs.append(values.outputs)
        current = values.next_states
        if restarts:
            restarted.append(outside(program, current, dtype))
            current = begun_again(current, restarted[-1], begun)
        nexts.append(current)
    rows = np.arange(record.t0, record.t0 + record.steps)
    first = {name: values[0] for name, values in states[0].items()}
    return Judgement(
        beginning=beginning_at(interface, log, record.t0, first),
        inputs=inputs_at(interface, log, rows),
        states=_joined(states),
        outputs=_joined(outputs),
        next_states=_joined(nexts),
        restarted=_joined(restarted) if restarted else {},
    )


def beginning_at(interface: StepInterface, log: Arrays, t0: int, states: Arrays) -> Beginning:
    """The samples at row t0 of a log, with these initial states."""
    windows = _samples(interface.start_windows, log, np.array([t0]))
    return Beginning(
        windows={port.signal.name: window[0] for port, window in windows},
        window_firsts={port.signal.name: port.first for port in interface.start_windows},
        states=states,
    )


def inputs_at(interface: StepInterface, log: Arrays, rows: NDArray[np.int64]) -> Arrays:
    """The values of every port at these rows of a log, (rows, *shape)."""
    return {port.signal.name: values for port, values in _samples(interface.inputs, log, rows)}


def _samples(
    ports: Sequence[Port], log: Mapping[str, NDArray[Any]], rows: NDArray[np.int64]
) -> list[tuple[Port, NDArray[Any]]]:
    """Each port's samples at every row, (rows, *shape of the port)."""
    found: list[tuple[Port, NDArray[Any]]] = []
    for port in ports:
        # windows oldest first, t last (R1)
        around = rows[:, None] + np.arange(port.first, port.last + 1)
        values = np.moveaxis(log[port.signal.name][around], 1, -1)
        found.append((port, values.reshape(len(rows), *port.type.shape)))
    return found


def _joined(steps: Sequence[Arrays]) -> Arrays:
    return {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}


def outside(program: Program, states: Arrays, dtype: DTypeLike) -> dict[str, NDArray[np.bool_]]:
    """Masks (steps,) of steps at which a state with `on_range: reset` is outside its range or NaN.

    Limits are rounded to the dtype of the deployed code.
    """
    found: dict[str, NDArray[np.bool_]] = {}
    for state in program.states:
        if state.on_range == "reset" and state.range is not None:
            low, high = np.asarray(state.range, dtype)
            values = states[state.name].reshape(len(states[state.name]), -1)
            found[state.name] = ~np.all((values >= low) & (values <= high), axis=1)
    return found


def begun_again(states: Arrays, at: Mapping[str, NDArray[np.bool_]], first: Arrays) -> Arrays:
    """The states, replaced by the initial values `first`, (1, *shape), at the steps in the masks
    `at`.
    """
    found = dict(states)
    for name, steps in at.items():
        values = np.array(states[name])
        values[steps] = first[name]
        found[name] = values
    return found
