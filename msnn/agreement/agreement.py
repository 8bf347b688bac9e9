"""Defines the result of comparing one export target with the reference interpreter."""

from __future__ import annotations

from msnn.agreement.faults import Fault
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Errors of one target, relative to each signal's largest magnitude."""

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
