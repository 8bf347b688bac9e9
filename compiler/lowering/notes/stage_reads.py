"""Notes what right-hand sides read at the stages of integrators."""

from __future__ import annotations

from dataclasses import field

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True)
class StageReads:
    """Names with the sub-model before them whose states are integrated; "" for the model itself."""

    inputs: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Those read after sample t, where an input that moves is not its sample."""
    parameters: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
