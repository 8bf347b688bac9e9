"""The kinds of layers: learned sums and networks, given numbers on knots, filters."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry, RefusedError, findings_of
from spec_schema.fields.formulas import (
    ARRAY,
    ArrayField,
    ExpressionField,
    PredictionField,
    read_array,
)
from spec_schema.fields.leaf import LeafField
from spec_schema.fields.plain import (
    ManyOf,
    PositiveCount,
    Reference,
    Switch,
    SwitchOrReference,
    choice,
    number,
    read_count,
    reads,
)
from spec_schema.fields.quantities import LengthField, PositiveLength, UnitField
from spec_schema.sections.values import Initializer
from spec_schema.yaml_tree.nodes import Node, Scalar

# below 1: the rest is divided by 1 − share, so that its mean stays
Share: TypeAlias = Annotated[float, number(least=0.0, below=1.0)]


class Fir(Entry):
    """A finite impulse response filter over a window; without `window` its argument must be one."""

    noun: ClassVar[str] = "a fir layer"

    window: PositiveLength | None = None
    """How far into the past it reaches, in samples or as a duration."""
    out: Reference | None = None
    bias: SwitchOrReference = False
    """Whether a learned constant is added, or the parameter that it is."""
    weight: Reference | None = None
    """Parameter that the weights are; by default they are the layer's own."""
    init: Initializer | None = None
    """Initial weights; small random numbers by default."""
    dropout: Share = 0.0
    """Share of the elements that training leaves out at random."""

    @model_validator(mode="after")
    # pydantic wants a method of each class: what both check is one function below
    def _has_one_start(self, info: ValidationInfo) -> "Fir":
        _refuse_two_starts(self, info)
        return self


class Linear(Entry):
    """An affine map of the last dim of its argument."""

    noun: ClassVar[str] = "a linear layer"

    out: Reference | None = None
    bias: SwitchOrReference = True
    """Whether a learned constant is added, or the parameter that it is."""
    weight: Reference | None = None
    """Parameter that the weights are; by default they are the layer's own."""
    init: Initializer | None = None
    """Initial weights; small random numbers by default."""
    dropout: Share = 0.0
    """Share of the elements that training leaves out at random."""

    @model_validator(mode="after")
    def _has_one_start(self, info: ValidationInfo) -> "Linear":
        _refuse_two_starts(self, info)
        return self


def _refuse_two_starts(entry: Fir | Linear, info: ValidationInfo) -> None:
    """Reports `init` of an entry whose `weight` names a parameter, because that has initial values
    of its own.
    """
    if entry.weight is not None and entry.init is not None:
        report = errors.excluded_key("init", "weight", entry.place.key, entry.noun)
        findings_of(info).report(report)


class Mlp(Entry):
    """A multilayer perceptron: affine maps with `activation` between them."""

    noun: ClassVar[str] = "an mlp layer"
    example: ClassVar[str | None] = "{hidden: [16, 16]}"

    hidden: ManyOf[PositiveCount]
    """Sizes of the hidden layers."""
    activation: Reference | None = None
    """Function between the layers."""
    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None
    """Initial weights; small random numbers by default."""
    dropout: Share = 0.0
    """Share of the elements that training leaves out at random."""


EQUATION_TERMS = ("identity", "neg", "square", "add", "sub", "mul")
"""Functions that an equation learner knows besides those of the language and of the spec."""


class EquationLearner(Entry):
    """A learned weighted sum of the `functions`, each applied to a learned linear combination of
    the elements of its argument.
    """

    noun: ClassVar[str] = "an equation_learner layer"

    functions: ManyOf[Reference]
    """Functions of which a weighted sum is learned."""
    mix: Switch = True
    """Whether each function gets a learned combination of the elements."""
    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None
    """Initial weights; small random numbers by default."""


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
    """The argument minus `mean`, divided by `std`; `NAME.inverse(…)` computes the reverse."""

    noun: ClassVar[str] = "a normalize layer"

    mean: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    """What is subtracted, or `data`."""
    std: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    """What it is divided by, or `data`."""
    of: Reference | None = None
    """Signal whose training rows `data` means; by default the argument."""
    unit: UnitField | None = None


LARGEST_ORDER = 64
"""Of a filter: beyond it coefficients in single precision lose their meaning."""


def order(least: int) -> LeafField:
    """A field that reads the order of a filter: an integer from `least` to LARGEST_ORDER. Others
    are reported, and raise RefusedError.
    """

    def read(node: Node, findings: Findings) -> int:
        found = read_count(node, findings, least)
        if found > LARGEST_ORDER:
            wanted = f"at most {LARGEST_ORDER}"
            findings.report(errors.out_of_range(str(found), node.span, wanted))
            raise RefusedError
        return found

    return reads(read, {"type": "integer", "minimum": least, "maximum": LARGEST_ORDER})


class Iir(Entry):
    """A recursive (IIR) filter with a numerator of order `num` and a denominator of order `den`."""

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
