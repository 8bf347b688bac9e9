"""Defines the kinds of faults of a target, and describes each in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msnn.agreement.judging.judgement import Proof
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FarStep:
    """An output, state or matrix whose single step differs by more than rounding."""

    of: str
    deviation: float
    """Error relative to the largest magnitude."""
    limit: float

    @property
    def difference(self) -> str:
        return (
            f"a step is off by {self.deviation:.1e} of the largest magnitude, "
            f"where rounding explains {self.limit:.1e}"
        )


@dataclass(frozen=True, slots=True)
class OtherBits:
    """An output or matrix whose bits differ, although identical bits are promised."""

    of: str
    bits: int
    """Number of values whose bits differ."""

    @property
    def difference(self) -> str:
        return f"{self.bits} values have other bits"


@dataclass(frozen=True, slots=True)
class BeyondProof:
    """A fixed-point output or state whose single step exceeds the proven error bound."""

    of: str
    step: int | None
    """Worst step, from 0; None for one of the additional steps with equal sides of a comparison."""
    error: float
    """Error in the unit of the value."""
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
    """An output or state that matches no branch of an undecided condition."""

    of: str
    step: int
    """Worst step, from 0."""
    error: float
    """Difference to the nearest branch, in the unit of the value."""

    @property
    def difference(self) -> str:
        return (
            f"step {self.step}, at which rounding decides a condition, is off by {self.error:.3g} "
            f"from the nearer of the choices"
        )


@dataclass(frozen=True, slots=True)
class NotOptimal:
    """Plans of a controller that are reported as solved but violate the optimality conditions."""

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
    """A self-test of an export that fails in the build on this machine."""

    of: str
    returned: int
    """Its return value; a comment of the C function explains the bits."""

    @property
    def difference(self) -> str:
        return f"it returns {self.returned}, where 0 says that all is well"


Fault = FarStep | OtherBits | BeyondProof | NoChoice | NotOptimal | SelfTestFails


def other_bits(counts: Mapping[str, int]) -> tuple[Fault, ...]:
    """Faults for values with differing bits."""
    return tuple(OtherBits(name, count) for name, count in counts.items() if count)


def beyond_proof(proof: Proof | None) -> tuple[Fault, ...]:
    """Faults for values of the fixed-point reference that exceed the proven error bound.

    Without this check, an export could agree with an equally wrong reference, because both use the
    same integer program.
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
