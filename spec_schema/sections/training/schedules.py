"""Changes the learning rate of a stage from epoch to epoch."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar

from spec_schema.fields.entry import Entry, OneOf
from spec_schema.fields.plain import PositiveCount, number

# 0 and 1 are both allowed: a rate that ends at 0, and one that stays
_Share = Annotated[float, number(least=0.0, most=1.0)]
# a rate of 0 would end training without a word, a factor above 1 would make it diverge
_Factor = Annotated[float, number(above=0.0, most=1.0)]


class Cosine(Entry):
    """Half a cosine from the whole rate down to `to` times the rate after the last epoch."""

    noun: ClassVar[str] = "the cosine schedule"

    to: _Share = 0.0
    """Share of the rate that is left at the end."""


class Exponential(Entry):
    """The rate times `factor` after each epoch."""

    noun: ClassVar[str] = "the exponential schedule"

    factor: _Factor = 0.99
    """What the rate is multiplied by."""


class Step(Entry):
    """The rate times `factor` after each `every` epochs."""

    noun: ClassVar[str] = "the step schedule"

    every: PositiveCount
    """Epochs between two reductions."""
    factor: _Factor = 0.1
    """What the rate is multiplied by."""


class Plateau(Entry):
    """The rate times `factor` after `patience` epochs without a better monitor, but not below
    `min` times the rate.
    """

    noun: ClassVar[str] = "the plateau schedule"
    former: ClassVar[Mapping[str, str]] = MappingProxyType({"least": "min"})

    patience: PositiveCount = 10
    """Epochs without a better monitor."""
    factor: _Factor = 0.1
    """What the rate is multiplied by."""
    min: _Share = 0.0
    """Lower limit of the rate, as a share of its value at the start."""


class Schedule(OneOf):
    """Lowers the learning rate of a stage, epoch by epoch."""

    noun: ClassVar[str] = "schedule"

    cosine: Cosine | None = None
    """Half a cosine."""
    exponential: Exponential | None = None
    """The same factor after each epoch."""
    step: Step | None = None
    """A factor after each so many epochs."""
    plateau: Plateau | None = None
    """A factor when the monitor gets no better."""

    @property
    def choice(self) -> Cosine | Exponential | Step | Plateau:
        """The one that is given."""
        given = self.cosine or self.exponential or self.step or self.plateau
        assert given is not None
        return given
