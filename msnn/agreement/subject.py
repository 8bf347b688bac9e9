"""Defines what is compared with the reference interpreter, and the result of a comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Program
from msnn.agreement.judgement import Arrays, Judge, NumberType, Promise
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """An export to compare: its program, weights, number type and promised accuracy."""

    target: str
    dtype: NumberType
    program: Program
    weights: Mapping[str, FloatArray]
    promise: Promise
    judge: Judge
    restarts: bool
    """True if it resets states with `on_range: reset`."""

    @property
    def is_exact(self) -> bool:
        """True if it promises identical bits."""
        return self.promise is Promise.BITS


@dataclass(frozen=True, slots=True)
class Deviations:
    """Differences between values and the reference, by their names in messages."""

    deviations: Mapping[str, float]
    rounding: Mapping[str, float]
    """Errors of the interpreter in single precision."""
    bits: Mapping[str, int]
    """Number of values whose bits differ from the interpreter's, if identical bits are promised."""
    undecided: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of steps without a bound of rounding errors, at which a value was not compared."""


NOTHING = Deviations({}, {}, {})


def worst_deviation(found: Arrays, wanted: Arrays) -> float:
    """max |a − b| / max(|b|, s) over all arrays, s = the largest magnitude of each one in `wanted`.

    Arrays are (steps, *shape); those in `found` may have fewer steps. The result is infinite if NaN
    or infinities are at different positions.
    """
    return max(deviations(found, wanted).values(), default=0.0)


def deviations(found: Arrays, wanted: Arrays) -> dict[str, float]:
    """For each array, max |a − b| / max(|b|, s), with s as in `worst_deviation`."""
    return {name: _deviation(found[name], wanted[name]) for name in wanted}


def bits_of_each(found: Arrays, wanted: Arrays) -> dict[str, int]:
    """Number of values per array that differ in any bit; all NaNs count as equal."""
    counts: dict[str, int] = {}
    for name, values in wanted.items():
        a, b = np.ascontiguousarray(found[name]), np.ascontiguousarray(values)
        # bits as integers: −0 and +0 differ, as do NaN of other payloads, which are let pass
        unsigned = {4: np.uint32, 8: np.uint64}[b.dtype.itemsize]
        same = a.view(unsigned) == b.view(unsigned)
        counts[name] = int(np.sum(~(same | (np.isnan(a) & np.isnan(b)))))
    return counts


def _deviation(found: NDArray[Any], wanted: NDArray[Any]) -> float:
    b = wanted.astype(np.float64)
    finite = np.isfinite(b)
    scale = float(np.abs(b[finite]).max(initial=0.0))
    a, b, finite = found.astype(np.float64), b[: len(found)], finite[: len(found)]
    others_differ = ~finite & ~((a == b) | (np.isnan(a) & np.isnan(b)))
    # NaN and ∞ have to stand where the judge has them
    if others_differ.any() or not np.isfinite(a[finite]).all():
        return math.inf
    error = float(np.abs(a[finite] - b[finite]).max(initial=0.0))
    if not error:
        return 0.0
    # of a signal that is 0 everywhere any error is infinite
    return error / scale if scale else math.inf
