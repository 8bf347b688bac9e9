"""Selects points for comparing Jacobians, including singular ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.ports.step_interface import Port, step_interface
from compiler.ir.program import History, Program, Tape
from msnn.agreement.judging.judgement import Arrays, Judgement

MOST_STEPS = 200
"""Maximum number of recorded steps."""
_MIXTURES = 40
TINY = 1e-9
"""A value slightly above 0."""

_Range: TypeAlias = tuple[float, float]
_Draw: TypeAlias = Callable[[NDArray[Any], _Range, bool], NDArray[Any]]
"""(recorded values, range, is input) → a value within the range."""


@dataclass(frozen=True, slots=True)
class Points:
    """Inputs and states of single steps, (points, *shape)."""

    inputs: Arrays
    states: Arrays
    count: int


def points(program: Program, judged: Judgement) -> Points:
    """The first recorded steps, then generated ones, always the same (Philox).

    Generated points are: all 0; inputs 0 and states slightly above; every range at its lower and at
    its upper limit; and mixtures. In a mixture, each quantity is one of these, random within its
    range, or a recorded value. Without a range, a quantity stays within its largest recorded
    magnitude, or within 1 if it is always 0.
    """
    # a generator whose numbers are the same on every machine and version
    random = np.random.Generator(np.random.Philox(0))
    corners: list[_Draw] = [
        # singular points are where slopes differ between tools: 0, a hair above, and ends of ranges
        lambda seen, range, is_input: np.zeros_like(seen[0]),
        lambda seen, range, is_input: np.full_like(seen[0], 0.0 if is_input else TINY),
        lambda seen, range, is_input: np.full_like(seen[0], range[0]),
        lambda seen, range, is_input: np.full_like(seen[0], range[1]),
    ]

    def mixed(seen: NDArray[Any], range: _Range, is_input: bool) -> NDArray[Any]:
        kind = int(random.integers(2 * len(corners)))
        if kind < len(corners):
            return corners[kind](seen, range, is_input)
        if kind % 2:
            low, high = range
            return random.uniform(low, high, seen.shape[1:])
        return seen[int(random.integers(len(seen)))]

    draws = [*corners, *[mixed] * _MIXTURES]
    steps = min(judged.steps, MOST_STEPS)
    ranges = _ranges(program)

    def extended(arrays: Arrays, *, are_inputs: bool) -> Arrays:
        found: dict[str, NDArray[Any]] = {}
        for name, seen in arrays.items():
            low, high = _finite(ranges[name], seen)
            # rounding may leave a drawn number outside by a digit
            drawn = [np.clip(draw(seen, (low, high), are_inputs), low, high) for draw in draws]
            # points of the record first, so that their places are those of its steps
            found[name] = np.concatenate([seen[:steps], np.array(drawn, seen.dtype)])
        return found

    return Points(
        extended(judged.inputs, are_inputs=True),
        extended(judged.states, are_inputs=False),
        steps + len(draws),
    )


def log_of(
    program: Program, inputs: Arrays, count: int, dtype: DTypeLike
) -> tuple[Mapping[str, NDArray[Any]], NDArray[np.int64]]:
    """A log, and its rows at which a step reads the inputs of each point."""
    ports = step_interface(program).inputs
    back = max([0, *(-port.first for port in ports)])
    span = back + max([0, *(port.last for port in ports)]) + 1
    # each point has rows of its own, as many as ports reach around
    rows = back + span * np.arange(count)
    log: dict[str, NDArray[Any]] = {}
    for port in ports:
        samples = _samples(port, inputs[port.signal.name])
        series = np.zeros((span * count, *samples.shape[2:]), dtype)
        for k in range(samples.shape[1]):
            series[rows + port.first + k] = samples[:, k]
        log[port.signal.name] = series
    return log, rows


def _samples(port: Port, values: NDArray[Any]) -> NDArray[Any]:
    """(points, samples, *shape of the signal)."""
    return values[:, np.newaxis] if port.type.window is None else np.moveaxis(values, -1, 1)


def _finite(range: _Range, seen: NDArray[Any]) -> _Range:
    """The range, with infinite ends replaced by the largest recorded magnitude."""
    largest = float(np.abs(np.where(np.isfinite(seen), seen, 0.0)).max(initial=0.0))
    span = largest if largest > TINY else 1.0
    low, high = range
    return (
        low if math.isfinite(low) else min(-span, high),
        high if math.isfinite(high) else max(span, low),
    )


def _ranges(program: Program) -> dict[str, _Range]:
    """The ranges of inputs and states; a delayed signal has the signal's range."""
    known = {signal.name: signal.range for signal in program.signals}
    anything = (-math.inf, math.inf)
    found = {name: range or anything for name, range in known.items()}
    for state in program.states:
        range = state.range
        match state.origin:
            case History(source):
                range = range or known.get(source)
            case Tape(signal, _):
                range = range or known.get(signal)
            case _:
                pass
        found[state.name] = range or anything
    return found
