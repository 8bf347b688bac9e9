"""Numbers with a unit, as written in a spec."""

from dataclasses import field

from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


@dataclass(frozen=True)
class Quantity:
    """A number and its unit; `unit` is None where only a number was written."""

    value: float
    unit: Unit | None
    span: Span = field(compare=False)

    @property
    def text(self) -> str:
        """As a spec writes it: `50 ms`, or `50` without a unit."""
        # enough to know the number again, and without the noise of 0.1 + 0.2
        number = f"{self.value:.12g}"
        return number if self.unit is None else f"{number} {self.unit.text}"


@dataclass(frozen=True)
class Range:
    """The lowest and the highest value of something, each in its own unit or in none."""

    low: Quantity
    high: Quantity
    span: Span = field(compare=False)
