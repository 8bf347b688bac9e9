"""Records the inputs and parameters that right-hand sides read at integrator stages."""

from __future__ import annotations

from dataclasses import field

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True)
class StageReads:
    """Pairs (sub-model whose states are integrated, name); the sub-model is "" for the model
    itself.
    """

    inputs: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Inputs read later than sample t, where an interpolated input differs from its sample."""
    parameters: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
