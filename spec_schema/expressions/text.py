"""Writes an expression as text, with the fewest parentheses that keep its meaning."""

from typing import assert_never

from spec_schema.expressions.tree import (
    Binary,
    Call,
    Compare,
    Duration,
    Expression,
    Future,
    Length,
    ListLiteral,
    Member,
    Name,
    Negate,
    Number,
    Operator,
    Past,
    Samples,
    TimeOffset,
    Window,
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
    """The text; `parse_expression` of it gives an equal expression."""
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
            return f"{expression_text(function)}({', '.join(given)})"
        case Negate(operand=operand):
            return f"-{_within(operand, _FACTOR)}"
        case Binary(operator=operator, left=left, right=right):
            return _binary_text(operator, left, right)
        case Compare(relation=relation, left=left, right=right):
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
    """The shortest text that reads back as the same float; whole numbers without `.0`."""
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
    """What a window is taken of; a dot behind a number would read as its decimal point."""
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
