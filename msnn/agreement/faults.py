"""Names the ways in which a target breaks its promise, and says each in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msnn.agreement.judging.judgement import Proof
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FarStep:
    """An output, state or matrix of which a step is farther from the judge than rounding is."""

    of: str
    deviation: float
    """Relative to the largest magnitude."""
    limit: float

    @property
    def difference(self) -> str:
        return (
            f"a step is off by {self.deviation:.1e} of the largest magnitude, "
            f"where rounding explains {self.limit:.1e}"
        )


@dataclass(frozen=True, slots=True)
class OtherBits:
    """An output or matrix that has other bits than the judge, where these are promised."""

    of: str
    bits: int
    """Values whose bits differ."""

    @property
    def difference(self) -> str:
        return f"{self.bits} values have other bits"


@dataclass(frozen=True, slots=True)
class BeyondProof:
    """An output or state in fixed point of which a step is off by more than is proved."""

    of: str
    step: int | None
    """Along the record, from 0; the worst. None for one of the steps beside it at which words are
    chosen so that comparisons are equal."""
    error: float
    """In the unit of the value."""
    bound: float

    @property
    def difference(self) -> str:
        where = (
            "a step beside the record, with equal sides of a comparison,"
            if self.step is None
            else (f"step {self.step}")
        )
        return (
            f"{where} is off by {self.error:.3g} from the same step in real numbers, "
            f"where at most {self.bound:.3g} is proved"
        )


@dataclass(frozen=True, slots=True)
class NoChoice:
    """An output or state that is none of the choices of a condition which rounding decides."""

    of: str
    step: int
    """Along the record, from 0; the worst."""
    error: float
    """From the nearest choice, in the unit of the value."""

    @property
    def difference(self) -> str:
        return (
            f"step {self.step}, at which rounding decides a condition, is off by {self.error:.3g} "
            f"from the nearer of the choices"
        )


@dataclass(frozen=True, slots=True)
class NotOptimal:
    """Plans of a controller that are called solved and do not meet the optimality conditions."""

    of: str
    residual: float
    limit: float

    @property
    def difference(self) -> str:
        return (
            f"its optimality conditions are off by {self.residual:.1e}, "
            f"where {self.limit:.1e} is promised"
        )


@dataclass(frozen=True, slots=True)
class SelfTestFails:
    """A self-test of an export that finds something wrong where it was built."""

    of: str
    returned: int
    """What it returned; the comment of the function says what its bits mean."""

    @property
    def difference(self) -> str:
        return f"it returns {self.returned}, where 0 says that all is well"


Fault = FarStep | OtherBits | BeyondProof | NoChoice | NotOptimal | SelfTestFails


def other_bits(counts: Mapping[str, int]) -> tuple[Fault, ...]:
    """The values of which some bits differ."""
    return tuple(OtherBits(name, count) for name, count in counts.items() if count)


def beyond_proof(proof: Proof | None) -> tuple[Fault, ...]:
    """The values of the judge itself that are not as near to real numbers as is proved.

    Bits that agree with the judge's are as wrong as these: what makes the integers of both is one.
    """
    if proof is None:
        return ()
    found: list[Fault] = []
    for name, bound in proof.bounds.items():
        errors = np.abs(proof.values[name] - proof.exact[name])
        # the worst element of each step; an output without elements is off by nothing
        errors = errors.reshape(len(errors), -1).max(axis=1, initial=0.0)
        worst = int(np.argmax(errors))  # NaN counts as the largest
        if not errors[worst] <= bound:
            step = worst if worst < proof.steps[name] else None
            found.append(BeyondProof(name, step, float(errors[worst]), bound))
    return tuple(found)
