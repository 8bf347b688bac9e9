"""Measures how far an integer program is from the same program in float64."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Declared, NodeId, Program, Signal, State
from compiler.ir.types import Type
from compiler.passes.analyses.saturation import saturated
from msnn.features.fixed_point.compile.word_formats import finite
from msnn.features.fixed_point.golden.golden import drawn
from msnn.features.fixed_point.integers.interpret import reset, step
from msnn.features.fixed_point.integers.program import IntegerProgram, WordPort

Reals = NDArray[np.float64]

LOST = 2.0**-48
"""Maximum float64 rounding error of a step, relative to the largest value of the format."""


@dataclass(frozen=True, slots=True)
class ExactSteps:
    """Outputs and next states of steps, (steps, *shape) each."""

    outputs: Mapping[str, Reals]
    next_states: Mapping[str, Reals]


class ExactStepper:
    """Computes steps of a program in step form in float64, for inputs and states with the values of
    given words.
    """

    def __init__(self, program: Program, weights: Mapping[str, NDArray[Any]]) -> None:
        self._program = program
        self._interpreter = Interpreter(reference(program), weights)
        self._reads = {
            node.op.signal: node.op for _, node in program.step if isinstance(node.op, ReadSignal)
        }
        self._windows = {
            node.op.signal
            for _, node in program.step
            if isinstance(node.op, ReadSignal) and node.type.window is not None
        }

    def steps(
        self, inputs: Mapping[str, Reals], states: Mapping[str, Reals], count: int
    ) -> ExactSteps:
        """Computes `count` independent steps; inputs, states and results are (count, *shape) by
        name.

        The integer program omits values multiplied by 0: such an input is set to a value in its
        range, such a state to 0.
        """
        known = dict(states)
        for state in self._program.states:
            if state.name not in known:
                shape = tuple(axis.size for axis in state.axes)
                known[state.name] = np.zeros((count, *shape))
        # rows before and after t that any signal reads: all series get as many for each step
        back = max([0, *(-op.first for op in self._reads.values())])
        length = back + max([0, *(op.last for op in self._reads.values())]) + 1
        log = {
            signal.name: self._series(signal, inputs.get(signal.name), count, back, length)
            for signal in self._program.signals
        }
        # the steps lie one behind the other in one log, and none reads rows of its neighbour
        rows = np.arange(count) * length + back
        with np.errstate(all="ignore"):
            found = self._interpreter.step(log, rows, known, losses=False)
        return ExactSteps(
            _repeated(found.outputs, count),
            _repeated(found.next_states, count),
        )

    def start(self, windows: Mapping[str, Reals], firsts: Mapping[str, int]) -> Mapping[str, Reals]:
        """The first states by name, (1, *shape), from `windows`, (*shape, samples) by name, whose
        oldest samples are at `firsts`.

        `firsts` is relative to the first step. The states are not limited to their ranges.
        """
        # as many rows before t0 as the longest look-back: every window then begins inside the log
        t0 = max([0, *(-first for first in firsts.values())])
        series: dict[str, Reals] = {}
        for name, window in windows.items():
            # samples first, as the rows of a log
            samples = np.moveaxis(window, -1, 0)
            # rows before the oldest sample of this window, so that all windows meet at t0
            ahead = np.zeros((t0 + firsts[name], *samples.shape[1:]))
            series[name] = np.concatenate([ahead, samples])
        rows = max([t0 + 1, *map(len, series.values())])
        log: dict[str, Reals] = {}
        for signal in self._program.signals:
            shape = tuple(axis.size for axis in signal.axes)
            filled = np.full((rows, *shape), _low_end(signal))
            if signal.name in series:
                filled[: len(series[signal.name])] = series[signal.name]
            log[signal.name] = filled
        return self._interpreter.start(log, t0)

    def _series(
        self, signal: Signal, values: Reals | None, count: int, back: int, length: int
    ) -> Reals:
        """A series of a signal in which each of `count` steps reads its own `length` rows, with
        `back` rows before its sample at t. `values` are (count, *shape) or None.
        """
        shape = tuple(axis.size for axis in signal.axes)
        series = np.full((count, length, *shape), _low_end(signal))
        if values is not None:
            read = self._reads[signal.name]
            is_window = signal.name in self._windows
            # (steps, …, samples) as rows of each step: (steps, samples, …)
            samples = np.moveaxis(values, -1, 1) if is_window else values[:, np.newaxis]
            series[:, back + read.first : back + read.last + 1] = samples
        return series.reshape(-1, *shape)


def reference(program: Program) -> Program:
    """The program that fixed point is compared with: its states are limited to their ranges too.

    Its inputs are unchecked, since words are always within their range.
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
    # words cannot leave their range: what is only flagged in float is kept within it here
    flagged = isinstance(state.origin, Declared) and state.on_range == "flag"
    if not flagged or state.range is None:
        return state
    before = builder.state(state.name, Type(state.axes, state.unit))
    following = saturated(builder, state.next, before, state.range)
    return replace(state, next=following, on_range="saturate")


def _low_end(signal: Signal) -> float:
    """The lower limit of a signal's range; 0 without a range, or if either limit is infinite."""
    return (finite(signal.range) or (0.0, 0.0))[0]


def _repeated(values: Mapping[str, NDArray[Any]], count: int) -> dict[str, Reals]:
    return {name: np.broadcast_to(v, (count, *v.shape[1:])) for name, v in values.items()}


# runs, steps of each and the seed of what is drawn
_RUNS, _STEPS, _SEED = 8, 1250, 11
HELD = 20
"""Steps for which every second run holds its inputs, so that errors can accumulate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputError:
    """The error of one output against float64 (largest and root mean square), and the span of its
    values.
    """

    name: str
    largest: float
    rms: float
    span: float
    steps: int
    """Number of compared steps."""

    @property
    def relative(self) -> float:
        """The largest error divided by the span; 0 if the span is 0."""
        return self.largest / self.span if self.span else 0.0


def output_errors(
    program: Program, weights: Mapping[str, NDArray[Any]], integers: IntegerProgram
) -> tuple[OutputError, ...]:
    """The errors of each output, over closed-loop runs of both interpreters from random pasts with
    inputs drawn from their full range.

    Both programs run on the same words. The span of an output is the declared range of the signal
    that it predicts, else the range of its values.
    """
    random = np.random.Generator(np.random.Philox(_SEED))
    spreads = {output.name: ErrorSpread(name=output.name) for output in program.outputs}
    stepper = ExactStepper(program, weights)
    ports = {port.name: port for port, _ in integers.outputs}
    inputs = {entry.port.name: entry.port for entry in integers.inputs}
    for run in range(_RUNS):
        windows = {port.name: drawn(port, random) for port in integers.windows}
        state = reset(integers, windows)
        states = stepper.start(
            {port.name: _real(port, windows[port.name]) for port in integers.windows},
            integers.first_samples,
        )
        words: dict[str, list[int]] = {}
        for k in range(_STEPS):
            # every second run changes its inputs in every step
            if run % 2 == 0 or k % HELD == 0:
                words = {name: drawn(port, random) for name, port in inputs.items()}
            # real numbers of the same words: what is measured is the arithmetic, not the rounding
            # of inputs
            answer = step(integers, state, words)
            real = {name: _real(port, words[name])[np.newaxis] for name, port in inputs.items()}
            result = stepper.steps(real, states, 1)
            states = result.next_states
            for name, words_out in answer.outputs.items():
                # words out become real numbers by their scale, as those in do
                found = np.ldexp(np.array(words_out, float), -ports[name].fraction)
                spreads[name].add(result.outputs[name].reshape(1, -1), found.reshape(1, -1))
    return tuple(spread.error(program) for spread in spreads.values())


@dataclass(slots=True, kw_only=True)
class ErrorSpread:
    """Accumulates the error of one output over several runs."""

    name: str
    steps: int = 0
    largest: float = 0.0
    squares: float = 0.0
    numbers: int = 0
    low: float = math.inf
    high: float = -math.inf

    def add(self, exact: NDArray[Any], found: NDArray[Any]) -> None:
        """Adds the values of steps, (steps, …): `exact` in float64, `found` those of words."""
        errors = found - exact
        self.steps += len(exact)
        self.numbers += errors.size
        self.largest = max(self.largest, float(np.abs(errors).max()))
        self.squares += float(np.sum(errors**2))
        self.low = min(self.low, float(exact.min()))
        self.high = max(self.high, float(exact.max()))

    def error(self, program: Program) -> OutputError:
        """The accumulated error; its span is the declared range of the predicted signal, else that
        of the values.
        """
        limits = _ranges(program).get(self.name)
        low, high = (self.low, self.high) if limits is None else limits
        rms = math.sqrt(self.squares / self.numbers)
        return OutputError(
            name=self.name, largest=self.largest, rms=rms, span=high - low, steps=self.steps
        )


def _ranges(program: Program) -> dict[str, tuple[float, float]]:
    """Finite ranges of the signals that outputs predict."""
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
