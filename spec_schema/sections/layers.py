"""The layers a spec can declare."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry, RefusedError, Variant, findings_of
from spec_schema.fields.formulas import (
    ARRAY,
    ArrayField,
    ExpressionField,
    PredictionField,
    read_array,
)
from spec_schema.fields.leaf import REFERENCE, Leaf
from spec_schema.fields.located import Located
from spec_schema.fields.plain import (
    ManyOf,
    PositiveCount,
    Reference,
    References,
    Switch,
    SwitchOrReference,
    choice,
    number,
    read_count,
    reads,
    scalar,
)
from spec_schema.fields.quantities import LengthField, PositiveLength, UnitField
from spec_schema.names import normalised
from spec_schema.sections.values import Initializer
from spec_schema.yaml_tree.nodes import Node, Scalar, Table

FromData: TypeAlias = Literal["data"]
Membership: TypeAlias = Literal["triangular", "rectangular", "gaussian"]


@dataclass(frozen=True)
class CustomMembership:
    """`{function: f}`: the degree of membership is f of the distance to the centre."""

    function: Located[str]


def _read_statistic(node: Node, findings: Findings) -> Expression | FromData:
    if isinstance(node, Scalar) and node.text == "data":
        return "data"
    return read_array(node, findings)


def _read_membership(node: Node, findings: Findings) -> Membership | CustomMembership:
    match node:
        case Table(entries={"function": Scalar() as function}) if len(node.entries) == 1:
            return CustomMembership(Located(normalised(function.text), function.span))
        case Table():
            repair = f"write {', '.join(_SHAPES)} or `{{function: NAME}}`"
            place = node.key or node.span
            findings.report(errors.wrong_kind("a membership", "another mapping", place, repair))
            raise RefusedError
        case _:
            found = scalar(node, findings, f"one of {', '.join(_SHAPES)}").text
            for word in _SHAPES:
                if word == found:
                    return word
            findings.report(errors.unknown_choice(found[:60], node.span, _SHAPES))
            raise RefusedError


_SHAPES: tuple[Membership, ...] = get_args(Membership)
_MEMBERSHIP = {
    "type": ["string", "object"],
    "pattern": f"^({'|'.join(_SHAPES)})$",
    "examples": list(_SHAPES),
    "properties": {"function": {"type": "string", "pattern": REFERENCE}},
    "required": ["function"],
    "additionalProperties": False,
}

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


Share: TypeAlias = Annotated[float, number(least=0.0, below=1.0)]


class Fir(Entry):
    """A finite impulse response over a window; without `window` its argument is one."""

    noun: ClassVar[str] = "a fir layer"

    window: PositiveLength | None = None
    out: Reference | None = None
    bias: SwitchOrReference = False
    weight: Reference | None = None
    init: Initializer | None = None
    dropout: Share = 0.0

    @model_validator(mode="after")
    def _has_one_start(self, info: ValidationInfo) -> "Fir":
        _refuse_two_starts(self, info)
        return self


class Linear(Entry):
    """An affine map of the last dim of its argument."""

    noun: ClassVar[str] = "a linear layer"

    out: Reference | None = None
    bias: SwitchOrReference = True
    weight: Reference | None = None
    init: Initializer | None = None
    dropout: Share = 0.0

    @model_validator(mode="after")
    def _has_one_start(self, info: ValidationInfo) -> "Linear":
        _refuse_two_starts(self, info)
        return self


def _refuse_two_starts(entry: Fir | Linear, info: ValidationInfo) -> None:
    """A named parameter brings its own initial values."""
    if entry.weight is not None and entry.init is not None:
        report = errors.excluded_key("init", "weight", entry.place.key, entry.noun)
        findings_of(info).report(report)


class Fuzzify(Entry):
    """Degrees of membership of a value in fuzzy sets around `centers`, or a grid `over` others."""

    noun: ClassVar[str] = "a fuzzify layer"

    centers: ArrayField | None = None
    membership: Annotated[Membership | CustomMembership, reads(_read_membership, _MEMBERSHIP)] = (
        "triangular"
    )
    dim: Reference | None = None
    learn: Switch = False
    over: References = ()
    combine: Annotated[Literal["product"], choice("product")] = "product"

    @model_validator(mode="after")
    def _has_sets(self, info: ValidationInfo) -> "Fuzzify":
        findings = findings_of(info)
        if self.centers is None and not self.over:
            findings.report(errors.missing_key("centers", self.place.key, self.noun))
        given = self.model_fields_set & {"centers", "membership", "dim", "learn"}
        for key in sorted(given) if self.over else ():
            findings.report(errors.excluded_key(key, "over", self.place.key, self.noun))
        return self


class Mlp(Entry):
    """A multilayer perceptron: affine maps with `activation` between them."""

    noun: ClassVar[str] = "an mlp layer"

    hidden: ManyOf[PositiveCount]
    activation: Reference | None = None
    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None
    dropout: Share = 0.0


EQUATION_TERMS = ("identity", "neg", "square", "add", "sub", "mul")
"""Functions that an equation learner knows besides those of the language and of the spec."""


class EquationLearner(Entry):
    """A weighted sum of `functions` of learned combinations of the argument's elements."""

    noun: ClassVar[str] = "an equation_learner layer"

    functions: ManyOf[Reference]
    mix: Switch = True
    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None


class Interpolation(Entry):
    """A table of values `y` on the knots `x`, or on the grid of the knots `x` and `x2`."""

    noun: ClassVar[str] = "an interpolation layer"

    x: ArrayField
    x2: ArrayField | None = None
    y: ArrayField
    unit: UnitField | None = None
    learn: Switch = False
    outside: Annotated[Literal["clamp", "extrapolate"], choice("clamp", "extrapolate")] = "clamp"


class Normalize(Entry):
    """A value less `mean`, divided by `std`; `NAME.inverse(…)` goes back."""

    noun: ClassVar[str] = "a normalize layer"

    mean: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    std: Annotated[Expression | FromData, reads(_read_statistic, ARRAY)]
    of: Reference | None = None
    unit: UnitField | None = None


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


class Cell(Variant):
    """The layer of which a local model has one copy for each fuzzy set."""

    noun: ClassVar[str] = "a cell"

    fir: Fir | None = None
    linear: Linear | None = None
    mlp: Mlp | None = None
    equation_learner: EquationLearner | None = None
    interpolation: Interpolation | None = None
    iir: Iir | None = None
    state_space: StateSpace | None = None


class LocalModel(Entry):
    """A sum of cells, each weighted by the product of its activations."""

    noun: ClassVar[str] = "a local_model layer"

    by: ManyOf[ExpressionField]
    cell: Cell


class Layer(Variant):
    """A declared layer."""

    noun: ClassVar[str] = "a layer"

    fir: Fir | None = None
    linear: Linear | None = None
    fuzzify: Fuzzify | None = None
    local_model: LocalModel | None = None
    mlp: Mlp | None = None
    equation_learner: EquationLearner | None = None
    interpolation: Interpolation | None = None
    normalize: Normalize | None = None
    iir: Iir | None = None
    state_space: StateSpace | None = None
    savitzky_golay: SavitzkyGolay | None = None
