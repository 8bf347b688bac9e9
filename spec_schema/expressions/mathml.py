"""Formats an expression as MathML, which browsers display without a library."""

from __future__ import annotations

from html import escape
from typing import assert_never

from spec_schema.expressions import tree
from spec_schema.expressions.formula_binding import ATOM, PRODUCT, binding, binding_of_operands
from spec_schema.expressions.tree import length_text, number_text, time_text

_RELATIONS = {
    tree.Relation.LESS: "<",
    tree.Relation.LESS_EQUAL: "≤",
    tree.Relation.GREATER: ">",
    tree.Relation.GREATER_EQUAL: "≥",
}
_JOINTS = {
    tree.Operator.ADD: "<mo>+</mo>",
    tree.Operator.SUBTRACT: "<mo>−</mo>",
    tree.Operator.MULTIPLY: "<mo>·</mo>",
    tree.Operator.CONTRACT: "<mo>·</mo>",
}


def expression_mathml(expression: tree.Expression) -> str:
    """The formula without the `math` element; samples are indices."""
    match expression:
        case tree.Number(value=value):
            return number_mathml(value)
        case tree.Duration():
            return _text(length_text(expression))
        case tree.Name(name=name):
            return name_mathml(name)
        case tree.Member(base=base, name=name):
            # above, as the place below is that of samples
            return f"<msup>{name_mathml(base)}{_text(name)}</msup>"
        case tree.Call():
            return _call(expression)
        case tree.Negate(operand=operand):
            return f"<mrow><mo>−</mo>{_within(operand, PRODUCT)}</mrow>"
        case tree.Binary(operator=operator, left=left, right=right):
            return _binary(operator, left, right)
        case tree.Compare(relation=relation, left=left, right=right):
            sign = f"<mo>{escape(_RELATIONS[relation])}</mo>"
            return f"<mrow>{expression_mathml(left)}{sign}{expression_mathml(right)}</mrow>"
        case tree.Window(operand=operand, first=first, last=last):
            ends = [first] if last is None else [first, last]
            return indexed(_within(operand, ATOM), " … ".join(map(time_text, ends)))
        case tree.Past(operand=operand, length=length):
            return indexed(_within(operand, ATOM), f"t−{length_text(length)} … t")
        case tree.Future(operand=operand, length=length):
            return indexed(_within(operand, ATOM), f"t … t+{length_text(length)}")
        case tree.ListLiteral(elements=elements):
            listed = "<mo>,</mo>".join(map(expression_mathml, elements))
            return f"<mrow><mo>[</mo>{listed}<mo>]</mo></mrow>"
        case _:
            assert_never(expression)


def name_mathml(name: str) -> str:
    """`theta_1` as θ with the index 1, `x_next` as x with the index next; words are upright."""
    # names of one letter are set in italics, words upright, as in print
    head, *rest = [part for part in name.split("_") if part] or [name]
    base = f"<mi>{escape(head)}</mi>" if len(head) == 1 else _text(head)
    return f"<msub>{base}{_text(','.join(rest))}</msub>" if rest else base


def number_mathml(value: float) -> str:
    """A number; powers of ten are written as such."""
    # `1e-06` is how text has it: mathematics writes 1 · 10⁻⁶
    mantissa, e, exponent = number_text(value).partition("e")
    number = f"<mn>{escape(mantissa)}</mn>"
    if not e:
        return number
    power = f"<msup><mn>10</mn><mn>{int(exponent)}</mn></msup>"
    return f"<mrow>{number}<mo>·</mo>{power}</mrow>"


def indexed(base: str, index: str) -> str:
    """MathML of a value with its sample as an index."""
    return f"<msub>{base}{_text(index)}</msub>"


def enclosed(inner: str) -> str:
    return f"<mrow><mo>(</mo>{inner}<mo>)</mo></mrow>"


def _text(text: str) -> str:
    return f"<mtext>{escape(text)}</mtext>"


def _call(call: tree.Call) -> str:
    # MathML has elements of its own for these
    if isinstance(call.function, tree.Name) and len(call.arguments) == 1 and not call.keywords:
        (argument,) = call.arguments
        match call.function.name:
            case "sqrt":
                return f"<msqrt>{expression_mathml(argument)}</msqrt>"
            case "abs":
                return f"<mrow><mo>|</mo>{expression_mathml(argument)}<mo>|</mo></mrow>"
            case "der":
                # in front of its operand: a fraction of a long formula would be taller than the
                # line
                slope = "<mfrac><mi>d</mi><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"
                return f"<mrow>{slope}{_within(argument, ATOM)}</mrow>"
            case _:
                pass
    parts = [expression_mathml(argument) for argument in call.arguments]
    parts += [
        f"<mrow>{name_mathml(word.name)}<mo>=</mo>{expression_mathml(word.value)}</mrow>"
        for word in call.keywords
    ]
    inner = "<mo>,</mo>".join(parts)
    return f"<mrow>{_function(call.function)}{enclosed(inner)}</mrow>"


def _function(function: tree.Name | tree.Member) -> str:
    # upright as a word: letters of one function in italics would read as a product
    if isinstance(function, tree.Name) and "_" not in function.name:
        return _text(function.name)
    if isinstance(function, tree.Member):
        return _text(f"{function.base}.{function.name}")
    return expression_mathml(function)


def _binary(operator: tree.Operator, left: tree.Expression, right: tree.Expression) -> str:
    if operator is tree.Operator.DIVIDE:
        above, below = expression_mathml(left), expression_mathml(right)
        return f"<mfrac><mrow>{above}</mrow><mrow>{below}</mrow></mfrac>"
    if operator is tree.Operator.POWER:
        # an exponent stands apart by itself and needs no parentheses
        return f"<msup>{_within(left, ATOM)}<mrow>{expression_mathml(right)}</mrow></msup>"
    least = binding_of_operands(operator)
    return f"<mrow>{_within(left, least)}{_JOINTS[operator]}{_within(right, least + 1)}</mrow>"


def _within(expression: tree.Expression, least: int) -> str:
    """The formula of a part, in parentheses if its precedence is too low."""
    text = expression_mathml(expression)
    return text if binding(expression) >= least else enclosed(text)
