"""The integrators of continuous states."""

from typing import ClassVar

from spec_schema.entry import Entry, Variant
from spec_schema.plain_fields import PositiveCount


class Euler(Entry):
    """Explicit Euler with steps of dt/substeps."""

    noun: ClassVar[str] = "the euler integrator"

    substeps: PositiveCount = 1


class Midpoint(Entry):
    """The explicit midpoint rule, a Runge-Kutta method of order 2, with steps of dt/substeps."""

    noun: ClassVar[str] = "the midpoint integrator"

    substeps: PositiveCount = 1


class RungeKutta4(Entry):
    """The classical Runge-Kutta method of order 4 with steps of dt/substeps."""

    noun: ClassVar[str] = "the rk4 integrator"

    substeps: PositiveCount = 1


class Integrator(Variant):
    """The method by which continuous states go from t to t+1."""

    noun: ClassVar[str] = "integrator"
    later: ClassVar[frozenset[str]] = frozenset({"semi_implicit", "linear_implicit"})

    euler: Euler | None = None
    midpoint: Midpoint | None = None
    rk4: RungeKutta4 | None = None

    @property
    def choice(self) -> Euler | Midpoint | RungeKutta4:
        """The one that is given."""
        given = self.euler or self.midpoint or self.rk4
        assert given is not None
        return given
