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
    x2: ArrayField | None = None
    y: ArrayField
    unit: UnitField | None = None
    learn: Switch = False
    outside: Annotated[Literal["clamp", "extrapolate"], choice("clamp", "extrapolate")] = "clamp"


FromData: TypeAlias = Literal["data"]


def _read_statistic(node: Node, findings: Findings) -> Expression | FromData:
    if isinstance(node, Scalar) and node.text == "data":
        return "data"
    return read_array(node, findings)


class Normalize(Entry):
    """A value less `mean`, divided by `std`; `NAME.inverse(…)` goes back."""

    noun: ClassVar[str] = "a normalize layer"

    mean: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    std: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    of: Reference | None = None
    unit: UnitField | None = None
