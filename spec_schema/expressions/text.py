"""Formats an expression as text, with the minimum of parentheses."""

from typing import assert_never

from spec_schema.expressions import tree

# How tightly a form binds, from comparison to atom; the grammar of LANGUAGE, `expr` to `atom`.
_COMPARE, _SUM, _TERM, _FACTOR, _POWER, _ATOM = range(6)
_BINDING = {
    tree.Operator.ADD: _SUM,
    tree.Operator.SUBTRACT: _SUM,
    tree.Operator.MULTIPLY: _TERM,
    tree.Operator.DIVIDE: _TERM,
    tree.Operator.CONTRACT: _TERM,
    tree.Operator.POWER: _POWER,
}


def expression_text(expression: tree.Expression) -> str:
    """The text; `parse_expression` of it gives an equal expression."""
    match expression:
        case tree.Number(value=value):
            return number_text(value)
        case tree.Duration():
            return length_text(expression)
        case tree.Name(name=name):
            return name
        case tree.Member(base=base, name=name):
            return f"{base}.{name}"
        case tree.Call(function=function, arguments=arguments, keywords=keywords):
            given = [expression_text(argument) for argument in arguments]
            given.extend(f"{word.name}={expression_text(word.value)}" for word in keywords)
            # positional first: the grammar has keywords behind them, as Python's
            return f"{expression_text(function)}({', '.join(given)})"
        case tree.Negate(operand=operand):
            # `-a**b` is −(a**b) without parentheses, `-(a + b)` needs them
            return f"-{_within(operand, _FACTOR)}"
        case tree.Binary(operator=operator, left=left, right=right):
            return _binary_text(operator, left, right)
        case tree.Compare(relation=relation, left=left, right=right):
            # a comparison within one is no expression, so both sides are at least sums
            return f"{_within(left, _SUM)} {relation.value} {_within(right, _SUM)}"
        case tree.Window(operand=operand, first=first, last=last):
            ends = [first] if last is None else [first, last]
            return f"{_subject(operand)}[{':'.join(time_text(end) for end in ends)}]"
        case tree.Past(operand=operand, length=length):
            return f"{_subject(operand)}.past({length_text(length)})"
        case tree.Future(operand=operand, length=length):
            return f"{_subject(operand)}.future({length_text(length)})"
        case tree.ListLiteral(elements=elements):
            return f"[{', '.join(expression_text(element) for element in elements)}]"
        case _:
            assert_never(expression)


def number_text(value: float) -> str:
    """The shortest text that reads back as the same float; integers without `.0`."""
    # repr() is the shortest text that reads back as the same float
    return repr(value).removesuffix(".0")


def length_text(length: tree.Length) -> str:
    """`5` samples, or `50 ms`."""
    match length:
        case tree.Samples(count=count):
            return str(count)
        case tree.Duration(quantity=quantity):
            assert quantity.unit is not None
            return f"{number_text(quantity.value)} {quantity.unit.text}"
        case _:
            assert_never(length)


def time_text(time: tree.TimeOffset) -> str:
    """`t`, `t+1` or `t-50 ms`."""
    if isinstance(time.length, tree.Samples) and time.length.count == 0:
        return "t"
    return f"t{'+' if time.sign == 1 else '-'}{length_text(time.length)}"


def _binary_text(operator: tree.Operator, left: tree.Expression, right: tree.Expression) -> str:
    if operator is tree.Operator.POWER:
        # `a**b**c` is a**(b**c), and −a**b is −(a**b)
        return f"{_within(left, _ATOM)}**{_within(right, _FACTOR)}"
    binding = _BINDING[operator]
    # the right operand of − and / needs more: a − (b − c)
    return f"{_within(left, binding)} {operator.value} {_within(right, binding + 1)}"


def _within(expression: tree.Expression, least: int) -> str:
    text = expression_text(expression)
    return text if _binding(expression) >= least else f"({text})"


def _subject(expression: tree.Expression) -> str:
    """The text a window is taken of; a dot behind a number would read as its decimal point."""
    # `1.past(2)` has a number `1.`
    if isinstance(expression, tree.Number | tree.Duration):
        return f"({expression_text(expression)})"
    return _within(expression, _ATOM)


def _binding(expression: tree.Expression) -> int:
    match expression:
        case tree.Compare():
            return _COMPARE
        case tree.Negate():
            return _FACTOR
        case tree.Binary(operator=operator):
            return _BINDING[operator]
        case (
            tree.Number()
            | tree.Duration()
            | tree.Name()
            | tree.Member()
            | tree.Call()
            | tree.Window()
            | tree.Past()
            | tree.Future()
            | tree.ListLiteral()
        ):
            return _ATOM
        case _:
            assert_never(expression)
