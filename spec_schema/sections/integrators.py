"""The integrators of continuous states."""

from typing import Annotated, ClassVar, TypeAlias

from spec_schema.fields.entry import Entry, OneOf
from spec_schema.fields.plain import Reference, count

Substeps: TypeAlias = Annotated[int, count(1, most=1000)]
"""Every one is written out in the program; who needs more has a stiff system."""


class Euler(Entry):
    """Explicit Euler with steps of dt/substeps."""

    noun: ClassVar[str] = "the euler integrator"

    substeps: Substeps = 1


class SemiImplicit(Entry):
    """Symplectic Euler, one state after the other as listed, with steps of dt/substeps."""

    noun: ClassVar[str] = "the semi_implicit integrator"

    substeps: Substeps = 1


class LinearImplicit(Entry):
    """Linearly implicit Euler, for stiff systems of few states, with steps of dt/substeps."""

    noun: ClassVar[str] = "the linear_implicit integrator"

    # an equation, not a state: its slope is all that the linear system has to hold
    of: Reference | None = None
    """Equation whose slope alone is implicit, such as a friction; without it all of them are."""
    substeps: Substeps = 1


class Midpoint(Entry):
    """The explicit midpoint rule, a Runge-Kutta method of order 2, with steps of dt/substeps."""

    noun: ClassVar[str] = "the midpoint integrator"

    substeps: Substeps = 1


class RungeKutta4(Entry):
    """The classical Runge-Kutta method of order 4 with steps of dt/substeps."""

    noun: ClassVar[str] = "the rk4 integrator"

    substeps: Substeps = 1


Method = Euler | SemiImplicit | LinearImplicit | Midpoint | RungeKutta4


class Integrator(OneOf):
    """The method by which continuous states go from t to t+1."""

    noun: ClassVar[str] = "integrator"

    euler: Euler | None = None
    semi_implicit: SemiImplicit | None = None
    linear_implicit: LinearImplicit | None = None
    midpoint: Midpoint | None = None
    rk4: RungeKutta4 | None = None

    @property
    def choice(self) -> Method:
        """The one that is given."""
        given = (
            self.euler or self.semi_implicit or self.linear_implicit or self.midpoint or self.rk4
        )
        assert given is not None
        return given
