"""Defines the result of comparing one export target with the reference, and its faults."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from msnn.agreement.judgement import Proof
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FarStep:
    """A fault: an output, state or matrix whose single step differs by more than rounding."""

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
    """A fault: an output or matrix whose bits differ, although identical bits are promised."""

    of: str
    bits: int
    """Number of values whose bits differ."""

    @property
    def difference(self) -> str:
        return f"{self.bits} values have other bits"


@dataclass(frozen=True, slots=True)
class BeyondProof:
    """A fault: a fixed-point output or state whose single step exceeds the proven error bound."""

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
    """A fault: where rounding decides a condition, an output or state that matches none of its
    branches.
    """

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
    """A fault: plans of a controller that are reported as solved but violate the optimality
    conditions.
    """

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
    """A fault: a self-test of an export that fails in the build on this machine."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """The result of comparing one export with the reference: errors relative to each signal's
    largest value.
    """

    target: str
    dtype: str
    steps: int
    one_step: float | None
    """Maximum error of the start and of single steps from reference states.

    None if states cannot be set.
    """
    free_run: float
    """Maximum error of a simulation of at most 1,000 steps; it grows for unstable models."""
    jacobian: float | None
    """Maximum error of a Jacobian; None without a Jacobian, or if identical bits are promised.

    At a kink, derivatives in two precisions may be unrelated.
    """
    bits: int | None
    """Number of values whose bits differ from the reference in the same arithmetic, if promised."""
    faults: tuple[Fault, ...]
    """Violations of the promise: of identical bits if promised, else of the error limit."""
    undecided: dict[str, int]
    """Number of steps at which rounding decides a branch, by value.

    There a value is compared with the results of both branches; the other columns exclude these
    steps.
    """
    untried: tuple[str, ...]
    """Values for which rounding decides a branch at all steps."""
    rounding: dict[str, float]
    """Errors of the interpreter itself in single precision, for outputs where they are large."""

    @property
    def agrees(self) -> bool:
        """True if the target keeps its promise."""
        return not self.faults
