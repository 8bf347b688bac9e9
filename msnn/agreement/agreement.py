"""Holds how far what was written for one target is from its judge."""

from __future__ import annotations

from msnn.agreement.faults import Fault
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """The deviation of one target from the judge, relative to each signal's largest magnitude."""

    target: str
    dtype: str
    steps: int
    one_step: float | None
    """The worst of the start and of all steps, each from the judge's state; None where states
    cannot be set."""
    free_run: float
    """The worst of a free run of at most 1,000 steps; grows where the model is unstable."""
    jacobian: float | None
    """The worst of a Jacobian; None where it has none, or where bits are promised: at a kink the
    slopes of two precisions have nothing in common."""
    bits: int | None
    """Values whose bits differ from the judge's in the same arithmetic, where bits are promised."""
    faults: tuple[Fault, ...]
    """Where the target breaks its promise: of bits where it has one, else of near numbers."""
    undecided: dict[str, int]
    """Steps at which rounding decides what a value is, where there are any: at these it is compared
    with what each choice gives, and the other columns leave them out."""
    untried: tuple[str, ...]
    """The values of which all steps are so."""
    rounding: dict[str, float]
    """What single precision costs the interpreter itself, of outputs where that is much."""

    @property
    def agrees(self) -> bool:
        """Whether the target keeps what it promises."""
        return not self.faults
