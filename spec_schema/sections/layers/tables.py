"""The layers made of given numbers: values on knots, and the mean and spread of data."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry
from spec_schema.fields.formulas import ARRAY, ArrayField, read_array
from spec_schema.fields.plain import Reference, Switch, choice, reads
from spec_schema.fields.quantities import UnitField
from spec_schema.yaml_tree.nodes import Node, Scalar


class Interpolation(Entry):
    """A table of values `y` on the knots `x`, or on the grid of the knots `x` and `x2`."""

    noun: ClassVar[str] = "an interpolation layer"

    x: ArrayField
    """Knots, ascending."""
    x2: ArrayField | None = None
    """Knots of the second axis of a grid."""
    y: ArrayField
    """Values on the knots."""
    unit: UnitField | None = None
    learn: Switch = False
    """Whether training changes the values."""
    outside: Annotated[Literal["clamp", "extrapolate"], choice("clamp", "extrapolate")] = "clamp"
    """What it does beyond the knots."""


FromData: TypeAlias = Literal["data"]


def _read_statistic(node: Node, findings: Findings) -> Expression | FromData:
    # before an expression is tried: `data` is no name of the spec here
    if isinstance(node, Scalar) and node.text == "data":
        return "data"
    return read_array(node, findings)


class Normalize(Entry):
    """A value less `mean`, divided by `std`; `NAME.inverse(…)` goes back."""

    noun: ClassVar[str] = "a normalize layer"

    mean: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    """What is subtracted, or `data`."""
    std: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    """What it is divided by, or `data`."""
    of: Reference | None = None
    """Signal whose training rows `data` means; by default the argument."""
    unit: UnitField | None = None
