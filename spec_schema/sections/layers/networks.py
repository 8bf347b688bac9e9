"""The layers whose weights training learns: sums of elements or samples, and networks."""

from typing import Annotated, ClassVar, TypeAlias

from pydantic import ValidationInfo, model_validator

from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, findings_of
from spec_schema.fields.plain import (
    ManyOf,
    PositiveCount,
    Reference,
    Switch,
    SwitchOrReference,
    number,
)
from spec_schema.fields.quantities import PositiveLength
from spec_schema.sections.values import Initializer

# below 1: the rest is divided by 1 − share, so that its mean stays
Share: TypeAlias = Annotated[float, number(least=0.0, below=1.0)]


class Fir(Entry):
    """A finite impulse response over a window; without `window` its argument is one."""

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
    """A named parameter brings its own initial values."""
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
    """A weighted sum of `functions` of learned combinations of the argument's elements."""

    noun: ClassVar[str] = "an equation_learner layer"

    functions: ManyOf[Reference]
    """Functions of which a weighted sum is learned."""
    mix: Switch = True
    """Whether each function gets a learned combination of the elements."""
    out: Reference | None = None
    bias: Switch = True
    init: Initializer | None = None
    """Initial weights; small random numbers by default."""
