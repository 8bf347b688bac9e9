"""A whole spec, in the order in which its sections are usually written."""

from typing import ClassVar

from pydantic import Field

from spec_schema.fields.entry import Entry
from spec_schema.fields.named_tables import Named
from spec_schema.fields.plain import EntriesOf, LanguageVersion, NewName, Text
from spec_schema.fields.quantities import SampleTime
from spec_schema.sections.data.data import Data
from spec_schema.sections.dimensions import Dimension, DimensionField
from spec_schema.sections.exports import Export
from spec_schema.sections.integrators import Integrator
from spec_schema.sections.layers.layer import Layer
from spec_schema.sections.signals import Equation, Loss, Output, Signal, State
from spec_schema.sections.submodels import Connection, Connections, Use
from spec_schema.sections.training.training import Stage
from spec_schema.sections.validation import Check
from spec_schema.sections.values import Constant, Function, Parameter


class Spec(Entry):
    """What a user wrote, each thing with its place; what it means is the compiler's business.

    `sample_time` is in seconds, None for a static model. `checks` is the section `validate`.
    """

    noun: ClassVar[str] = "the spec"
    later: ClassVar[frozenset[str]] = frozenset({"mpc"})

    msnn: LanguageVersion
    name: NewName
    doc: Text | None = None
    sample_time: SampleTime | None = None
    dims: Named[DimensionField] = Field(default_factory=dict[str, Dimension])
    use: Named[Use] = Field(default_factory=dict[str, Use])
    inputs: Named[Signal]
    targets: Named[Signal] = Field(default_factory=dict[str, Signal])
    constants: Named[Constant] = Field(default_factory=dict[str, Constant])
    parameters: Named[Parameter] = Field(default_factory=dict[str, Parameter])
    layers: Named[Layer] = Field(default_factory=dict[str, Layer])
    functions: Named[Function] = Field(default_factory=dict[str, Function])
    states: Named[State] = Field(default_factory=dict[str, State])
    integrator: Integrator | None = None
    equations: Named[Equation] = Field(default_factory=dict[str, Equation])
    connect: Connections = Field(default_factory=dict[str, Connection])
    outputs: Named[Output]
    losses: Named[Loss] = Field(default_factory=dict[str, Loss])
    data: Data | None = None
    train: EntriesOf[Stage] = ()
    checks: EntriesOf[Check] = Field(default=(), alias="validate")
    export: Export | None = None
