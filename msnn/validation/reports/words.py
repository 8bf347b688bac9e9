"""Words that tables and plots of validations share."""

from __future__ import annotations

from typing import Protocol

from spec_schema.units.unit import Unit


class Simulated(Protocol):
    """What says how it was simulated."""

    @property
    def horizon(self) -> str: ...

    @property
    def closed(self) -> tuple[str, ...]: ...


def rollout_text(row: Simulated) -> str:
    """How it was simulated: `one step`, `50 steps, closing x`."""
    closed = f", closing {', '.join(row.closed)}" if row.closed else ""
    if row.horizon == "1":
        return f"one step{closed}"
    return f"{row.horizon} steps{closed}" if row.horizon.isdecimal() else f"{row.horizon}{closed}"


def unit_text(unit: Unit | None) -> str:
    """The unit as it was written, empty without one."""
    return "" if unit is None else unit.text
