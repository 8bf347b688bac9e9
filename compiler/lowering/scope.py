"""Maps the names of a spec to their declarations; all sections share one namespace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import names as errors
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.dimensions import Dimension
from spec_schema.sections.layers.layer import Layer
from spec_schema.sections.signals import Equation, Output, Signal, State
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Function, Parameter

Entry = (
    Use | Dimension | Signal | Constant | Parameter | Layer | Function | State | Equation | Output
)


class Kind(Enum):
    """The section that declares a name; the value is its wording in messages."""

    SUBMODEL = "a sub-model"
    DIMENSION = "a dimension"
    INPUT = "an input"
    TARGET = "a target"
    CONSTANT = "a constant"
    PARAMETER = "a parameter"
    LAYER = "a layer"
    FUNCTION = "a function"
    STATE = "a state"
    EQUATION = "an equation"
    OUTPUT = "an output"


@dataclass(frozen=True)
class Declaration:
    """A name and its entry in the spec."""

    name: str
    kind: Kind
    entry: Entry


def owner_of(name: str) -> str:
    """The sub-model that a full name belongs to; "" for the model itself."""
    return name.rpartition(".")[0]


class Scope(Mapping[str, Declaration]):
    """All declared names. A second declaration is reported; the first one stays valid."""

    def __init__(self, spec: Spec, findings: Findings) -> None:
        self._declared: dict[str, Declaration] = {}
        sections: tuple[tuple[Kind, Mapping[str, Entry]], ...] = (
            (Kind.SUBMODEL, spec.use),
            (Kind.DIMENSION, spec.dims),
            (Kind.INPUT, spec.inputs),
            (Kind.TARGET, spec.targets),
            (Kind.CONSTANT, spec.constants),
            (Kind.PARAMETER, spec.parameters),
            (Kind.LAYER, spec.layers),
            (Kind.FUNCTION, spec.functions),
            (Kind.STATE, spec.states),
            (Kind.EQUATION, spec.equations),
            (Kind.OUTPUT, spec.outputs),
        )
        # if two sections declare a name, the later one in this order is reported
        for kind, section in sections:
            for name, entry in section.items():
                first = self._declared.get(name)
                if first is None:
                    self._declared[name] = Declaration(name, kind, entry)
                else:
                    findings.report(
                        errors.declared_twice(
                            name, entry.place.key, first.entry.place.key, first.kind.value
                        )
                    )

    def __getitem__(self, name: str) -> Declaration:
        return self._declared[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._declared)

    def __len__(self) -> int:
        return len(self._declared)
