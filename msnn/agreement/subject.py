"""Defines what is compared with the reference interpreter, and the result of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Judge, NumberType, Promise
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """An export's program and weights, and the accuracy that it promises."""

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
