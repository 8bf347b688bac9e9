"""Keeps what one lowering of a spec finds out for the next: only lowered expressions tell it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from compiler.elaboration.named_values.histories import Buffers, Remembered
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


@dataclass(frozen=True)
class FoundBefore:
    """Nothing in the first lowering; a spec is lowered until the next one finds the same."""

    buffers: Buffers = field(default_factory=dict[str, Remembered])
    """What is remembered of states and equations, and how long."""
    units: Mapping[str, Unit] = field(default_factory=dict[str, Unit])
    """Of the centres of fuzzy sets that are read as values: those of what their layer is called
    with, before or after."""
