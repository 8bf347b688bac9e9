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
