"""Says what is compared with a judge, and what comparing its values with the judge's gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Judge, NumberType, Promise
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """An export's program and weights, and what it promises."""

    target: str
    dtype: NumberType
    program: Program
    weights: Mapping[str, FloatArray]
    promise: Promise
    judge: Judge
    restarts: bool
    """Whether it takes states with `on_range: reset` back."""

    @property
    def is_exact(self) -> bool:
        """Whether it promises bits."""
        return self.promise is Promise.BITS


@dataclass(frozen=True, slots=True)
class Deviations:
    """The distances of values from the judge's, by their names in messages."""

    deviations: Mapping[str, float]
    rounding: Mapping[str, float]
    """What the interpreter in single precision is off."""
    bits: Mapping[str, int]
    """Values that differ from that interpreter's, where bits are promised."""
    undecided: Mapping[str, int] = field(default_factory=dict[str, int])
    """Steps at which nothing bounds the rounding of a value, so that it was not compared."""


NOTHING = Deviations({}, {}, {})
