"""Defines expressions as a closed union of frozen nodes, each with its span."""

from dataclasses import field
from enum import Enum
from typing import Literal, TypeAlias

from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.units.quantity import Quantity


class Operator(Enum):
    """A binary operator; the value is its spelling."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    CONTRACT = "@"
    POWER = "**"


class Relation(Enum):
    """A comparison; the value is its spelling."""

    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="


@dataclass(frozen=True)
class Number:
    """A finite literal."""

    # places take no part in equality, here and below: one formula written twice is one value
    value: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Samples:
    """A length counted in samples."""

    count: int
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Duration:
    """A length of time such as `50 ms`; the unit is one of us, ms, s, min, h."""

    quantity: Quantity
    span: Span = field(compare=False)

    @property
    def seconds(self) -> float:
        """The length in seconds."""
        assert self.quantity.unit is not None
        return self.quantity.unit.in_si(self.quantity.value)


Length: TypeAlias = Samples | Duration


@dataclass(frozen=True)
class Name:
    """A bare name."""

    name: str
    span: Span = field(compare=False)


@dataclass(frozen=True)
class LanguageName(Name):
    """A predefined name of the language, which a spec cannot redefine."""


@dataclass(frozen=True)
class Member:
    """`base.name`: the log of a signal (`q.meas`) or a member of a sub-model (`vehicle.A`).

    `base` may be a name with dots: `vehicle.tire.mu` has the base `vehicle.tire`."""

    base: str
    name: str
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Keyword:
    """`name=value` in a call; `span` covers both."""

    name: str
    value: "Expression"
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Call:
    """A layer, function or builtin applied to arguments."""

    function: Name | Member
    arguments: tuple["Expression", ...]
    keywords: tuple[Keyword, ...]
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Negate:
    """Unary minus."""

    operand: "Expression"
    span: Span = field(compare=False)


@dataclass(frozen=True, kw_only=True)
class Binary:
    """Two operands and an operator; `operator_span` is the place of the operator itself."""

    operator: Operator
    left: "Expression"
    right: "Expression"
    span: Span = field(compare=False)
    operator_span: Span = field(compare=False)


@dataclass(frozen=True)
class Compare:
    """A comparison; the parser admits it only as the condition of `where`."""

    relation: Relation
    left: "Expression"
    right: "Expression"
    span: Span = field(compare=False)


@dataclass(frozen=True)
class TimeOffset:
    """`t`, `t+3` or `t-1 s`: the sample `sign * length` away from now (`t` is +0 samples)."""

    sign: Literal[-1, 1]
    length: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Window:
    """`x[t-4:t]` (both ends inclusive), or the single sample `x[t-1]` when `last` is None."""

    operand: "Expression"
    first: TimeOffset
    last: TimeOffset | None
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Past:
    """`x.past(1 s)`: the samples of that length that end at t."""

    operand: "Expression"
    length: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Future:
    """`x.future(1 s)`: the samples t+1 … of that length."""

    operand: "Expression"
    length: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class ListLiteral:
    """`[1, 2, 3]`; a list of lists is a matrix."""

    elements: tuple["Expression", ...]
    span: Span = field(compare=False)


Expression: TypeAlias = (
    Number
    | Duration
    | Name
    | Member
    | Call
    | Negate
    | Binary
    | Compare
    | Window
    | Past
    | Future
    | ListLiteral
)
