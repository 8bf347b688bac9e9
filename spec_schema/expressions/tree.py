"""Defines expressions as a closed union of nodes with spans, and writes them as text."""

from dataclasses import field
from enum import Enum
from typing import Literal, TypeAlias, assert_never

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
    """A finite number in an expression."""

    # places take no part in equality, here and below: one formula written twice is one value
    value: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Samples:
    """A length as a number of samples."""

    count: int
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Duration:
    """A length of time such as `50 ms`; the unit is one of us, ms, s, min, h."""

    quantity: Quantity
    span: Span = field(compare=False)

    @property
    def seconds(self) -> float:
        """The duration in seconds."""
        assert self.quantity.unit is not None
        return self.quantity.unit.in_si(self.quantity.value)


Length: TypeAlias = Samples | Duration


@dataclass(frozen=True)
class Name:
    """A name without dots."""

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
    """`x.past(1 s)`: the window of x with the latest samples, up to t, that this length covers."""

    operand: "Expression"
    length: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Future:
    """`x.future(1 s)`: the window of x with the samples after t, from t+1, that this length
    covers.
    """

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


# How tightly a form binds, from comparison to atom; the grammar of LANGUAGE, `expr` to `atom`.
_COMPARE, _SUM, _TERM, _FACTOR, _POWER, _ATOM = range(6)
_BINDING = {
    Operator.ADD: _SUM,
    Operator.SUBTRACT: _SUM,
    Operator.MULTIPLY: _TERM,
    Operator.DIVIDE: _TERM,
    Operator.CONTRACT: _TERM,
    Operator.POWER: _POWER,
}


def expression_text(expression: Expression) -> str:
    """The text of an expression; parsing it gives an equal expression."""
    match expression:
        case Number(value=value):
            return number_text(value)
        case Duration():
            return length_text(expression)
        case Name(name=name):
            return name
        case Member(base=base, name=name):
            return f"{base}.{name}"
        case Call(function=function, arguments=arguments, keywords=keywords):
            given = [expression_text(argument) for argument in arguments]
            given.extend(f"{word.name}={expression_text(word.value)}" for word in keywords)
            # positional first: the grammar has keywords behind them, as Python's
            return f"{expression_text(function)}({', '.join(given)})"
        case Negate(operand=operand):
            # `-a**b` is −(a**b) without parentheses, `-(a + b)` needs them
            return f"-{_within(operand, _FACTOR)}"
        case Binary(operator=operator, left=left, right=right):
            return _binary_text(operator, left, right)
        case Compare(relation=relation, left=left, right=right):
            # a comparison within one is no expression, so both sides are at least sums
            return f"{_within(left, _SUM)} {relation.value} {_within(right, _SUM)}"
        case Window(operand=operand, first=first, last=last):
            ends = [first] if last is None else [first, last]
            return f"{_subject(operand)}[{':'.join(time_text(end) for end in ends)}]"
        case Past(operand=operand, length=length):
            return f"{_subject(operand)}.past({length_text(length)})"
        case Future(operand=operand, length=length):
            return f"{_subject(operand)}.future({length_text(length)})"
        case ListLiteral(elements=elements):
            return f"[{', '.join(expression_text(element) for element in elements)}]"
        case _:
            assert_never(expression)


def number_text(value: float) -> str:
    """The shortest text that reads back as the same float; integers without `.0`."""
    # repr() is the shortest text that reads back as the same float
    return repr(value).removesuffix(".0")


def length_text(length: Length) -> str:
    """`5` samples, or `50 ms`."""
    match length:
        case Samples(count=count):
            return str(count)
        case Duration(quantity=quantity):
            assert quantity.unit is not None
            return f"{number_text(quantity.value)} {quantity.unit.text}"
        case _:
            assert_never(length)


def time_text(time: TimeOffset) -> str:
    """`t`, `t+1` or `t-50 ms`."""
    if isinstance(time.length, Samples) and time.length.count == 0:
        return "t"
    return f"t{'+' if time.sign == 1 else '-'}{length_text(time.length)}"


def _binary_text(operator: Operator, left: Expression, right: Expression) -> str:
    if operator is Operator.POWER:
        # `a**b**c` is a**(b**c), and −a**b is −(a**b)
        return f"{_within(left, _ATOM)}**{_within(right, _FACTOR)}"
    binding = _BINDING[operator]
    # the right operand of − and / needs more: a − (b − c)
    return f"{_within(left, binding)} {operator.value} {_within(right, binding + 1)}"


def _within(expression: Expression, least: int) -> str:
    text = expression_text(expression)
    return text if _binding(expression) >= least else f"({text})"


def _subject(expression: Expression) -> str:
    """The text of the expression whose window is taken, in parentheses if needed."""
    # `1.past(2)` has a number `1.`
    if isinstance(expression, Number | Duration):
        return f"({expression_text(expression)})"
    return _within(expression, _ATOM)


def _binding(expression: Expression) -> int:
    match expression:
        case Compare():
            return _COMPARE
        case Negate():
            return _FACTOR
        case Binary(operator=operator):
            return _BINDING[operator]
        case (
            Number()
            | Duration()
            | Name()
            | Member()
            | Call()
            | Window()
            | Past()
            | Future()
            | ListLiteral()
        ):
            return _ATOM
        case _:
            assert_never(expression)
