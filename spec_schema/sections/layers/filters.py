"""The filters: recursive ones, linear systems, and polynomials fitted to a window."""

from typing import Annotated, ClassVar, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, RefusedError
from spec_schema.fields.formulas import ExpressionField, PredictionField
from spec_schema.fields.leaf import LeafField
from spec_schema.fields.plain import Reference, Switch, number, read_count, reads
from spec_schema.fields.quantities import LengthField, PositiveLength
from spec_schema.yaml_tree.nodes import Node

LARGEST_ORDER = 64
"""Of a filter: beyond it coefficients in single precision lose their meaning."""


def order(least: int) -> LeafField:
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
    """Order of the numerator."""
    den: Annotated[int, order(1)]
    """Order of the denominator."""
    init: ExpressionField | None = None
    """Value of the filter before the first sample."""
    fit: PredictionField | None = None
    """Logged signal, `y[t+k]`, whose training rows it is fitted to before the first stage."""


class StateSpace(Entry):
    """A linear system with a state vector of `order` elements."""

    noun: ClassVar[str] = "a state_space layer"

    order: Annotated[int, order(1)]
    """Elements of its state vector."""
    out: Reference | None = None
    feedthrough: Switch = False
    """Whether the argument reaches the result in the same step."""
    radius: Annotated[float, number(above=0.0, most=1.0)] = 0.999
    """Largest magnitude of its poles."""
    init: ExpressionField | None = None
    """Its state before the first sample."""
    fit: PredictionField | None = None
    """Logged signal, `y[t+k]`, whose training rows it is fitted to before the first stage."""


Degree: TypeAlias = Annotated[int, order(0)]


class SavitzkyGolay(Entry):
    """A smoothed value or derivative: a polynomial of `order` fitted to a window."""

    noun: ClassVar[str] = "a savitzky_golay layer"

    window: PositiveLength | None = None
    """How far into the past it reaches, in samples or as a duration."""
    order: Degree = 2
    """Degree of the fitted polynomial."""
    derivative: Degree = 0
    """Which derivative with respect to time; 0 smooths."""
    lag: LengthField | None = None
    """How long before t the polynomial is evaluated."""
