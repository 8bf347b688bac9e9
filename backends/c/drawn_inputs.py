"""Draws what golden vectors begin with: samples around t0 and inputs, some of them invalid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface import InputField
from compiler.program import Program, Signal, extents

Array = NDArray[Any]

_INVALID_EVERY = 5
"""Steps from one invalid value to the next, where the policy replaces them."""


def drawn_log(program: Program, random: np.random.Generator) -> tuple[dict[str, Array], int]:
    """A record as long as the start graph needs, and the row of t0 in it."""
    reads = extents(program.start, log=True)
    t0 = max([0, *(-extent.first for extent in reads.values())])
    rows = t0 + 1 + max([0, *(extent.last for extent in reads.values())])
    # a measured state starts anywhere in its range
    ranges = {state.name: state.range for state in program.states}
    log: dict[str, Array] = {}
    for name in reads:
        signal = program.signal(name)
        shape = tuple(axis.size for axis in signal.axes)
        limits = _drawable(signal.range or ranges.get(name))
        log[name] = random.uniform(*limits, (rows, *shape))
    return log, t0


def drawn_series(input: InputField, steps: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Values of an input, (steps, *shape), within its range or [-1, 1] but for invalid ones.

    Where the policy replaces invalid values there are some of each kind; where it lets them pass,
    one is outside the range, and the last is NaN, as it would spoil what follows.
    """
    signal = input.port.signal
    series = random.uniform(*_drawable(signal.range), (steps, *input.field.shape))
    first = series.reshape(steps, -1)[:, 0]
    kinds = _outside(signal)
    match signal.on_invalid:
        case "clamp" | "hold":
            for number, step in enumerate(range(_INVALID_EVERY // 2, steps, _INVALID_EVERY)):
                first[step] = kinds[number % len(kinds)]
        case "flag" if steps > 1:
            if math.isfinite(kinds[0]):
                first[steps // 2] = kinds[0]
            first[-1] = math.nan
        case _:
            pass
    return series


def _drawable(range: tuple[float, float] | None) -> tuple[float, float]:
    """Finite limits to draw between."""
    if range is None:
        return -1.0, 1.0
    low, high = range
    if math.isfinite(low):
        return low, high if math.isfinite(high) else low + 2.0
    return (high - 2.0, high) if math.isfinite(high) else (-1.0, 1.0)


def _outside(signal: Signal) -> tuple[float, ...]:
    """One value of every kind that is invalid, finite ones first."""
    finite: tuple[float, ...] = ()
    if signal.range is not None:
        low, high = signal.range
        margin = 1.0 + abs(high - low) if math.isfinite(high - low) else 1.0
        finite = tuple(v for v in (high + margin, low - margin) if math.isfinite(v))
    return (*finite, math.nan, math.inf, -math.inf)
