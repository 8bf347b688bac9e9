"""Stores facts that one lowering of a spec finds for the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from compiler.elaboration.named_values.histories import Buffers, Remembered
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


@dataclass(frozen=True)
class FoundBefore:
    """Facts of the previous lowering, empty at first. Lowering repeats until they do not change."""

    buffers: Buffers = field(default_factory=dict[str, Remembered])
    """Buffers of states and equations, with their lengths."""
    units: Mapping[str, Unit] = field(default_factory=dict[str, Unit])
    """Units of centres of fuzzy sets that are read as values, from the argument of their layer."""
