"""Measures how far an integer program is from the same program in float64."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.fixed_point.constants import finite
from compiler.fixed_point.golden import drawn
from compiler.fixed_point.integers.interpret import reset, step
from compiler.fixed_point.integers.program import IntegerProgram, WordPort
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_step
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Declared, NodeId, Program, State
from compiler.ir.saturation import saturated
from compiler.ir.types import Type

_RUNS, _STEPS, _SEED = 8, 1250, 11
HELD = 20
"""Steps for which every second run keeps its inputs, so that errors can add up."""


@dataclass(frozen=True, slots=True)
class OutputError:
    """The error of one output, and the span of its values in float64."""

    name: str
    largest: float
    rms: float
    span: float
    steps: int
    """Over so many steps."""

    @property
    def relative(self) -> float:
        """The largest error as a part of the range."""
        return self.largest / self.span if self.span else 0.0


def output_errors(
    program: Program, weights: Mapping[str, NDArray[Any]], integers: IntegerProgram
) -> tuple[OutputError, ...]:
    """Errors over closed runs from drawn pasts, inputs drawn from all of their range.

    Both run on the same words. The span of an output is the range that the spec declares for what
    it predicts, else what its values cover.
    """
    random = np.random.Generator(np.random.Philox(_SEED))
    exact = reference(program)
    spreads = {output.name: Spread(output.name) for output in program.outputs}
    interpreter = Interpreter(exact, weights)
    extents = _extents(program)
    ports = {port.name: port for port, _ in integers.outputs}
    for run in range(_RUNS):
        windows = {port.name: drawn(port, random) for port in integers.windows}
        state = reset(integers, windows)
        log, t0 = _record(program, integers, windows)
        states = interpreter.start(log, t0)
        words: dict[str, list[int]] = {}
        for k in range(_STEPS):
            if run % 2 == 0 or k % HELD == 0:
                words = {entry.port.name: drawn(entry.port, random) for entry in integers.inputs}
            answer = step(integers, state, words)
            row_log, row = _row(program, integers, words, extents)
            result = interpreter.step(row_log, row, states, losses=False)
            states = result.next_states
            for name, words_out in answer.outputs.items():
                found = np.ldexp(np.array(words_out, float), -ports[name].fraction)
                spreads[name].add(result.outputs[name].reshape(1, -1), found.reshape(1, -1))
    return tuple(spread.error(program) for spread in spreads.values())


def reference(program: Program) -> Program:
    """The program that fixed point is compared with: its states keep to their ranges too.

    Its inputs are taken as they are, since words are within their range.
    """
    builder, copies = GraphBuilder(), dict[NodeId, NodeId]()
    for index, node in program.step:
        copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    moved = with_step(program, builder.graph(), copies)
    states = tuple(_within_range(builder, state) for state in moved.states)
    trusted = tuple(replace(s, range=None, on_invalid="trust") for s in program.signals)
    return replace(
        moved, step=builder.graph(), states=states, signals=trusted, losses=(), expected=()
    )


def _within_range(builder: GraphBuilder, state: State) -> State:
    flagged = isinstance(state.origin, Declared) and state.on_range == "flag"
    if not flagged or state.range is None:
        return state
    before = builder.state(state.name, Type(state.axes, state.unit))
    following = saturated(builder, state.next, before, state.range)
    return replace(state, next=following, on_range="saturate")


@dataclass(slots=True)
class Spread:
    """What is known of the error of an output after some steps."""

    name: str
    steps: int = 0
    largest: float = 0.0
    squares: float = 0.0
    numbers: int = 0
    low: float = math.inf
    high: float = -math.inf

    def add(self, exact: NDArray[Any], found: NDArray[Any]) -> None:
        """Values (steps, …) in float64 and of words."""
        errors = found - exact
        self.steps += len(exact)
        self.numbers += errors.size
        self.largest = max(self.largest, float(np.abs(errors).max()))
        self.squares += float(np.sum(errors**2))
        self.low = min(self.low, float(exact.min()))
        self.high = max(self.high, float(exact.max()))

    def error(self, program: Program) -> OutputError:
        """All of it; its span is the declared range of what the output predicts, if there is."""
        limits = _ranges(program).get(self.name)
        low, high = (self.low, self.high) if limits is None else limits
        rms = math.sqrt(self.squares / self.numbers)
        return OutputError(self.name, self.largest, rms, high - low, self.steps)


def _ranges(program: Program) -> dict[str, tuple[float, float]]:
    """Finite ranges of what outputs predict."""
    declared = {state.name: state.range for state in program.states}
    declared |= {signal.name: signal.range for signal in program.signals if signal.range}
    found: dict[str, tuple[float, float]] = {}
    for output in program.outputs:
        limits = declared.get(output.predicts.signal) if output.predicts else None
        if limits is not None and all(map(math.isfinite, limits)):
            found[output.name] = limits
    return found


def _real(port: WordPort, words: list[int]) -> NDArray[np.float64]:
    shape = tuple(axis.size for axis in port.axes)
    return np.ldexp(np.array(words, np.float64), -port.fraction).reshape(shape)


def _record(
    program: Program, integers: IntegerProgram, windows: Mapping[str, list[int]]
) -> tuple[dict[str, NDArray[Any]], int]:
    """The record that the windows are cut from, and the row of the first step in it."""
    t0 = max([0, *(-first for first in integers.window_firsts)])
    log: dict[str, NDArray[Any]] = {}
    for port, first in zip(integers.windows, integers.window_firsts, strict=True):
        samples = np.moveaxis(_real(port, windows[port.name]), -1, 0)
        series = np.zeros((t0 + first + len(samples), *samples.shape[1:]))
        series[t0 + first :] = samples
        log[port.name] = series
    return _padded(program, log, t0 + 1), t0


def _extents(program: Program) -> dict[str, tuple[int, bool]]:
    """The first sample that the step reads of each input, and whether it is a window."""
    return {
        node.op.signal: (node.op.first, node.type.window is not None)
        for _, node in program.step
        if isinstance(node.op, ReadSignal)
    }


def _row(
    program: Program,
    integers: IntegerProgram,
    words: Mapping[str, list[int]],
    extents: Mapping[str, tuple[int, bool]],
) -> tuple[dict[str, NDArray[Any]], int]:
    """A log that holds the samples of one step, and its row."""
    row = max([0, *(-first for first, _ in extents.values())])
    log: dict[str, NDArray[Any]] = {}
    for entry in integers.inputs:
        first, is_window = extents[entry.port.name]
        value = _real(entry.port, words[entry.port.name])
        samples = np.moveaxis(value, -1, 0) if is_window else value[np.newaxis]
        series = np.zeros((row + first + len(samples), *samples.shape[1:]))
        series[row + first :] = samples
        log[entry.port.name] = series
    return _padded(program, log, row + 1), row


def _padded(program: Program, log: dict[str, NDArray[Any]], least: int) -> dict[str, NDArray[Any]]:
    """A series of every signal, with as many rows as the longest.

    The integers may do without an input that float64 reads, as what multiplies it is 0: it stands
    somewhere in its range.
    """
    rows = max([least, *(len(series) for series in log.values())])
    found: dict[str, NDArray[Any]] = {}
    for signal in program.signals:
        shape = tuple(axis.size for axis in signal.axes)
        series = log.get(signal.name)
        if series is None:
            low, _ = finite(signal.range) or (0.0, 0.0)
            found[signal.name] = np.full((rows, *shape), low)
        else:
            found[signal.name] = np.concatenate([series, np.zeros((rows - len(series), *shape))])
    return found
