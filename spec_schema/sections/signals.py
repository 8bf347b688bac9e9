"""The signals a spec declares: inputs, targets, states, equations, outputs, losses."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import states as state_errors
from spec_schema.expressions.tree import Expression, Length, Samples, length_text
from spec_schema.fields.entry import Entry, OneOf, findings_of, single_key
from spec_schema.fields.formulas import ExpressionField, PredictionField
from spec_schema.fields.leaf import Choice
from spec_schema.fields.plain import (
    NonNegativeNumber,
    References,
    Text,
    choice,
    located_choice,
    reads,
)
from spec_schema.fields.quantities import (
    POSITIVE_LENGTH,
    RangeField,
    UnitField,
    read_positive_length,
)
from spec_schema.yaml_tree.nodes import Node, Scalar, Table

InvalidPolicy: TypeAlias = Literal["clamp", "hold", "flag", "trust"]
RangePolicy: TypeAlias = Literal["flag", "saturate", "reset"]
BetweenSamples: TypeAlias = Literal["hold", "linear"]


class Signal(Entry):
    """An input or a target. Without `unit` its unit is unknown, without `dims` it is a scalar.

    `on_invalid` is the reaction of a generated controller to a sample that is NaN or out of range.
    """

    noun: ClassVar[str] = "a signal"
    shorthand: ClassVar[str | None] = "unit"
    unit: UnitField | None = None
    dims: References = ()
    range: RangeField | None = None
    """Lowest and highest value that is plausible, numbers in its unit or with one."""
    # `flag` by default: it reports and changes no number, so that C agrees with training
    on_invalid: Annotated[InvalidPolicy, choice("clamp", "hold", "flag", "trust")] = "flag"
    """What generated code does with a sample that is NaN or out of range."""
    doc: Text | None = None


_OVER = {
    **POSITIVE_LENGTH,
    "pattern": f"{POSITIVE_LENGTH['pattern']}|^record$",
    "examples": ["record"],
}


def _read_over(node: Node, findings: Findings) -> Length | Literal["record"]:
    # the word first: a length would read `record` as an unknown unit
    if isinstance(node, Scalar) and node.text == "record":
        return "record"
    return read_positive_length(node, findings)


class FittedStart(Entry):
    """An initial value that is estimated for each run by least squares, from its first `over`
    samples.

    The initial values of all such states together minimise the squared errors in the losses. The
    search begins at `from`.
    """

    noun: ClassVar[str] = "a fitted initial value"

    over: Annotated[Length | Literal["record"], reads(_read_over, _OVER)]
    """First evaluations of each run that decide it and are not scored; `record`: all of the run."""
    begin: ExpressionField | None = Field(default=None, alias="from")
    """Where the search begins, from the log: `x.meas`; 0 by default."""

    @property
    def words(self) -> str:
        """A text for publications, such as `fitted to the first 20 samples of each run`."""
        if self.over == "record":
            return "fitted to each run"
        unit = " samples" if isinstance(self.over, Samples) else ""
        return f"fitted to the first {length_text(self.over)}{unit} of each run"


class InitialState(OneOf):
    """The value of a state before the first step: an expression, or `fit`. A lone expression is
    `value`.
    """

    noun: ClassVar[str] = "an initial state"

    value: ExpressionField | None = None
    """An expression of the log: `x.meas`."""
    fit: FittedStart | None = None
    """Found by least squares for each run."""

    @classmethod
    def canonical(cls, node: Node, findings: Findings) -> Node:
        # an expression is never a mapping: whatever is one names its variant
        named = isinstance(node, Table)
        return super().canonical(node if named else single_key(node, "value"), findings)

    @property
    def expression(self) -> Expression | None:
        """The expression of the initial value, or for an estimated one that of the initial guess;
        None if there is none.
        """
        return self.value if self.fit is None else self.fit.begin


class Input(Signal):
    """An input, which the model also reads between its samples if it has differential equations.

    `between: linear` is then the straight line from one sample to the next, `hold` the last sample.
    """

    noun: ClassVar[str] = "an input"

    between: Annotated[Choice[BetweenSamples], located_choice("hold", "linear")] | None = None
    """What right-hand sides read between samples: the last one held, or the line to the next."""

    @property
    def is_linear(self) -> bool:
        """True if the input is interpolated linearly between samples."""
        return self.between is not None and self.between.value == "linear"


class State(Entry):
    """A state of the model. `der` is its derivative in time (continuous), `next` its value at t+1
    (discrete); at least one is given.

    `on_range` is the reaction to a next value outside `range`. `flag` reports it. `saturate` limits
    the state to the range, in every engine. `reset`, for generated C only, sets it back to `init`.
    """

    noun: ClassVar[str] = "a state"

    unit: UnitField | None = None
    dims: References = ()
    der: ExpressionField | None = None
    """Derivative with respect to time."""
    next: ExpressionField | None = None
    """Value at t+1."""
    init: InitialState | None = None
    """Value before the first step, from the log: `x.meas`, or `{fit: {over: 20}}`."""
    history: ExpressionField | None = None
    """Values before the start, where windows reach back that far."""
    range: RangeField | None = None
    """Lowest and highest value that is plausible, numbers in its unit or with one."""
    on_range: Annotated[Choice[RangePolicy], located_choice("flag", "saturate", "reset")] | None = (
        None
    )
    """What becomes of a next value outside `range`: a report, its end, or `init`."""
    doc: Text | None = None

    @property
    def start(self) -> Expression | None:
        """The expression of the value before the first step; None without `init`, or if it is
        estimated from 0.
        """
        # None is 0 for the compiler, and nothing to check for who looks for reads of the log
        return None if self.init is None else self.init.expression

    @property
    def range_policy(self) -> RangePolicy:
        """The reaction to values outside `range`: that of `on_range`, by default `flag`."""
        return "flag" if self.on_range is None else self.on_range.value

    @model_validator(mode="after")
    def _moves(self, info: ValidationInfo) -> "State":
        # both are right together: `next` may change what `flow(x)` gives
        if self.der is None and self.next is None:
            findings_of(info).report(state_errors.state_without_law(self.place.key))
        return self

    @model_validator(mode="after")
    def _has_what_it_acts_on(self, info: ValidationInfo) -> "State":
        if self.on_range is not None and self.range is None:
            findings_of(info).report(state_errors.nothing_to_act_on(self.on_range.span))
        return self


class Equation(Entry):
    """A named expression. `range` are its plausible values."""

    noun: ClassVar[str] = "an equation"
    shorthand: ClassVar[str | None] = "expr"

    expr: ExpressionField
    """The expression."""
    unit: UnitField | None = None
    history: ExpressionField | None = None
    """Values before the start, where windows reach back that far."""
    range: RangeField | None = None
    """Lowest and highest value that is plausible, numbers in its unit or with one."""
    doc: Text | None = None


class Output(Entry):
    """A result of the model; `predicts` is the logged sample that it predicts."""

    noun: ClassVar[str] = "an output"
    shorthand: ClassVar[str | None] = "expr"

    expr: ExpressionField
    """The expression."""
    predicts: PredictionField | None = None
    """Logged sample that it stands for, `x[t+1]`: loss, metric and feedback."""
    unit: UnitField | None = None
    history: ExpressionField | None = None
    """Values before the start, where windows reach back that far."""
    doc: Text | None = None


class Loss(Entry):
    """A term of the training loss, and its weight, which has no unit."""

    noun: ClassVar[str] = "a loss"
    shorthand: ClassVar[str | None] = "expr"

    expr: ExpressionField
    """A loss such as `mse(a, b)`."""
    weight: NonNegativeNumber = 1.0
    """Its weight in the total."""
    rows: ExpressionField | None = None
    """Factor of each row, of logged signals: 2 counts twice, 0 is not scored."""
