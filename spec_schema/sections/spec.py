"""A whole spec, in the order in which its sections are usually written; integrators."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, TypeAlias, TypeVar

from pydantic import Field

from spec_schema.fields.entry import Entry, Named, OneOf
from spec_schema.fields.plain import EntriesOf, LanguageVersion, NewName, Reference, Text, count
from spec_schema.fields.quantities import SampleTime
from spec_schema.registry import SECTIONS, SectionLine, with_keys
from spec_schema.sections.data import Data
from spec_schema.sections.exports import Export
from spec_schema.sections.layers import Layer
from spec_schema.sections.signals import Equation, Input, Loss, Output, Signal, State
from spec_schema.sections.submodels import Connection, Connections, Use
from spec_schema.sections.training import Stage, Validation
from spec_schema.sections.values import Constant, Dimension, DimensionField, Function, Parameter

Substeps: TypeAlias = Annotated[int, count(1, most=1000)]
"""Every one is written out in the program; who needs more has a stiff system."""


class Euler(Entry):
    """Explicit Euler with steps of dt/substeps."""

    noun: ClassVar[str] = "the euler integrator"

    substeps: Substeps = 1


class SemiImplicit(Entry):
    """Symplectic Euler: the states are advanced one after the other, in the order of the spec, with
    steps of dt/substeps.
    """

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
    """The numerical method that advances continuous states from t to t+1."""

    noun: ClassVar[str] = "integrator"

    euler: Euler | None = None
    semi_implicit: SemiImplicit | None = None
    linear_implicit: LinearImplicit | None = None
    midpoint: Midpoint | None = None
    rk4: RungeKutta4 | None = None

    @property
    def choice(self) -> Method:
        """The settings of the chosen integrator."""
        given = (
            self.euler or self.semi_implicit or self.linear_implicit or self.midpoint or self.rk4
        )
        assert given is not None
        return given


E = TypeVar("E", bound=Entry)


@with_keys(SECTIONS)
class Spec(Entry):
    """The spec as a user wrote it, each entry with its place in the file. The compiler determines
    its meaning.

    `sample_time` is in seconds, None for a static model. `checks` is the section `validate`.
    """

    noun: ClassVar[str] = "the spec"
    msnn: LanguageVersion
    """Version of the language: 1."""
    name: NewName
    """Name of the model; generated code and files bear it."""
    doc: Text | None = None
    sample_time: SampleTime | None = None
    """Time between two samples, or a frequency; a model without it is static."""
    dims: Named[DimensionField] = Field(default_factory=dict[str, Dimension])
    """Named dimensions: their size, or the labels of their elements."""
    use: Named[Use] = Field(default_factory=dict[str, Use])
    """Other specs that are parts of this one, by the names they have here."""
    inputs: Named[Input]
    """Signals that the model reads, logged and deployed."""
    targets: Named[Signal] = Field(default_factory=dict[str, Signal])
    """Signals that only training and metrics read."""
    constants: Named[Constant] = Field(default_factory=dict[str, Constant])
    """Numbers that are fixed when the spec is compiled."""
    parameters: Named[Parameter] = Field(default_factory=dict[str, Parameter])
    """Values that training learns."""
    layers: Named[Layer] = Field(default_factory=dict[str, Layer])
    """Functions with weights, called by their names."""
    functions: Named[Function] = Field(default_factory=dict[str, Function])
    """Formulas with arguments, written out where they are called."""
    states: Named[State] = Field(default_factory=dict[str, State])
    """Memory of the model: continuous (`der`) or discrete (`next`)."""
    integrator: Integrator | None = None
    """How continuous states go from sample to sample; `rk4` by default."""
    equations: Named[Equation] = Field(default_factory=dict[str, Equation])
    """Named expressions, in any order."""
    connect: Connections = Field(default_factory=dict[str, Connection])
    """What feeds the inputs of sub-models: `plant.u: expression`."""
    outputs: Named[Output]
    """Results of the model."""
    losses: Named[Loss] = Field(default_factory=dict[str, Loss])
    """Terms that training makes small; by default what outputs predict is compared."""
    data: Data | None = None
    """Measured files and which column is which signal."""
    train: EntriesOf[Stage] = ()
    """Stages of training, each from the best weights of the one before."""
    # pydantic's models have a method of that name
    checks: EntriesOf[Validation] = Field(default=(), alias="validate")
    """What is measured of the trained model, with limits."""
    export: Export | None = None
    """What `msnn export` writes."""
    # fields of sections that features bring, such as `mpc`, follow from the registry

    def sections(self) -> Iterator[tuple[SectionLine, Entry]]:
        """Yields the sections of features that the spec has, each with its line of the registry, in
        the order of the registry.
        """
        for line in SECTIONS:
            # a spec that was read before a plug-in was found lacks its field
            entry = getattr(self, line.key, None)
            if entry is not None:
                yield line, entry

    def of(self, kind: type[E]) -> E | None:
        """The section of a feature that has this class; None if the spec has none."""
        return next((entry for _, entry in self.sections() if isinstance(entry, kind)), None)
