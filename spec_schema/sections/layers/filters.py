"""The filters: recursive ones, linear systems, and polynomials fitted to a window."""

from typing import Annotated, ClassVar, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, RefusedError
from spec_schema.fields.formulas import ExpressionField, PredictionField
from spec_schema.fields.leaf import Leaf
from spec_schema.fields.plain import Reference, Switch, number, read_count, reads
from spec_schema.fields.quantities import LengthField, PositiveLength
from spec_schema.yaml_tree.nodes import Node

LARGEST_ORDER = 64
"""Of a filter: beyond it coefficients in single precision lose their meaning."""


def order(least: int) -> Leaf:
    """Validates the order of a filter."""

    def read(node: Node, findings: Findings) -> int:
        found = read_count(node, findings, least)
        if found > LARGEST_ORDER:
            wanted = f"at most {LARGEST_ORDER}"
            findings.report(errors.out_of_range(str(found), node.span, wanted))
            raise RefusedError
        return found

    return reads(read, {"type": "integer", "minimum": least, "maximum": LARGEST_ORDER})


class Iir(Entry):
    """A recursive filter with a numerator of order `num` and a denominator of order `den`."""

    noun: ClassVar[str] = "an iir layer"

    num: Annotated[int, order(0)]
    den: Annotated[int, order(1)]
    init: ExpressionField | None = None
    fit: PredictionField | None = None


class StateSpace(Entry):
    """A linear system with a state vector of `order` elements."""

    noun: ClassVar[str] = "a state_space layer"

    order: Annotated[int, order(1)]
    out: Reference | None = None
    feedthrough: Switch = False
    radius: Annotated[float, number(above=0.0, most=1.0)] = 0.999
    init: ExpressionField | None = None
    fit: PredictionField | None = None


Degree: TypeAlias = Annotated[int, order(0)]


class SavitzkyGolay(Entry):
    """A smoothed value or derivative: a polynomial of `order` fitted to a window."""

    noun: ClassVar[str] = "a savitzky_golay layer"

    window: PositiveLength | None = None
    order: Degree = 2
    derivative: Degree = 0
    lag: LengthField | None = None
