"""Measures the error of an integer program against the same program in float64."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Program
from msnn.features.fixed_point.deviation.exact_steps import ExactStepper
from msnn.features.fixed_point.golden.golden import drawn
from msnn.features.fixed_point.integers.interpret import reset, step
from msnn.features.fixed_point.integers.program import IntegerProgram, WordPort

# runs, steps of each and the seed of what is drawn
_RUNS, _STEPS, _SEED = 8, 1250, 11
HELD = 20
"""Steps for which every second run holds its inputs, so that errors can accumulate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputError:
    """The error of one output, and the span of its values in float64."""

    name: str
    largest: float
    rms: float
    span: float
    steps: int
    """Number of compared steps."""

    @property
    def relative(self) -> float:
        """The largest error divided by the span."""
        return self.largest / self.span if self.span else 0.0


def output_errors(
    program: Program, weights: Mapping[str, NDArray[Any]], integers: IntegerProgram
) -> tuple[OutputError, ...]:
    """Errors over closed-loop runs from random pasts with inputs drawn from their full range.

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
    """Accumulates statistics of an output's error."""

    name: str
    steps: int = 0
    largest: float = 0.0
    squares: float = 0.0
    numbers: int = 0
    low: float = math.inf
    high: float = -math.inf

    def add(self, exact: NDArray[Any], found: NDArray[Any]) -> None:
        """Adds values (steps, …) in float64 and those of words."""
        errors = found - exact
        self.steps += len(exact)
        self.numbers += errors.size
        self.largest = max(self.largest, float(np.abs(errors).max()))
        self.squares += float(np.sum(errors**2))
        self.low = min(self.low, float(exact.min()))
        self.high = max(self.high, float(exact.max()))

    def error(self, program: Program) -> OutputError:
        """The accumulated error; its span is the declared range of the predicted signal, if any."""
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
