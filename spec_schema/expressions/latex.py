"""Formats an expression as LaTeX."""

import unicodedata
from typing import assert_never

from spec_schema.expressions import tree
from spec_schema.expressions.formula_binding import ATOM, PRODUCT, binding, binding_of_operands
from spec_schema.expressions.tree import length_text, number_text, time_text

_FUNCTIONS = {"sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "min", "max"}
_ARC = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}
_RELATIONS = {
    tree.Relation.LESS: "<",
    tree.Relation.LESS_EQUAL: r"\leq",
    tree.Relation.GREATER: ">",
    tree.Relation.GREATER_EQUAL: r"\geq",
}
_JOINTS = {
    tree.Operator.ADD: " + ",
    tree.Operator.SUBTRACT: " - ",
    tree.Operator.MULTIPLY: r" \, ",
    tree.Operator.CONTRACT: r" \cdot ",
}


def expression_latex(expression: tree.Expression) -> str:
    """The formula without math delimiters; samples are indices: `x_{t-1}`."""
    match expression:
        case tree.Number(value=value):
            return number_latex(value)
        case tree.Duration():
            return rf"\mathrm{{{length_text(expression).replace(' ', chr(92) + ',')}}}"
        case tree.Name(name=name):
            return name_latex(name)
        case tree.Member(base=base, name=name):
            return rf"{name_latex(base)}^{{\mathrm{{{_safe(name)}}}}}"
        case tree.Call():
            return _call(expression)
        case tree.Negate(operand=operand):
            return f"-{_within(operand, PRODUCT)}"
        case tree.Binary(operator=operator, left=left, right=right):
            return _binary(operator, left, right)
        case tree.Compare(relation=relation, left=left, right=right):
            return f"{expression_latex(left)} {_RELATIONS[relation]} {expression_latex(right)}"
        case tree.Window(operand=operand, first=first, last=last):
            ends = [first] if last is None else [first, last]
            return _at(operand, r"{:}".join(time_text(end) for end in ends))
        case tree.Past(operand=operand, length=length):
            return _at(operand, rf"t-{_length(length)}{{:}}t")
        case tree.Future(operand=operand, length=length):
            return _at(operand, rf"t{{:}}t+{_length(length)}")
        case tree.ListLiteral(elements=elements):
            return rf"\left[{', '.join(map(expression_latex, elements))}\right]"
        case _:
            assert_never(expression)


def name_latex(name: str) -> str:
    """`theta_1` as θ with the index 1, `x_next` as x with the index next; words are upright."""
    head, *rest = [part for part in name.split("_") if part]
    base = _letter(head)
    return base + (rf"_{{\mathrm{{{_safe(','.join(rest))}}}}}" if rest else "")


def number_latex(value: float) -> str:
    """A number; powers of ten are written as such."""
    mantissa, e, exponent = number_text(value).partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if e else mantissa


def _letter(word: str) -> str:
    if len(word) == 1 and word.isascii():
        return word
    if len(word) == 1:
        # LaTeX knows Greek letters by their English names
        return _greek(word)
    return rf"\mathrm{{{_safe(word)}}}"


def _greek(letter: str) -> str:
    """The command of a Greek letter; capitals that look Latin have none."""
    words = unicodedata.name(letter, "").lower().split()
    # capitals that look Latin have no command
    if words[:1] != ["greek"] or len(words) != 4 or words[3] in _NO_COMMAND:
        return rf"\mathrm{{{letter}}}"
    word = {"lamda": "lambda", "final": "sigma"}.get(words[3], words[3])
    if words[1] == "small":
        return rf"\{word}"
    return rf"\{word.capitalize()}" if word in _CAPITALS else rf"\mathrm{{{letter}}}"


_NO_COMMAND = {"omicron"}
_CAPITALS = {
    "gamma",
    "delta",
    "theta",
    "lambda",
    "xi",
    "pi",
    "sigma",
    "upsilon",
    "phi",
    "psi",
    "omega",
}


def _safe(text: str) -> str:
    return text.replace("_", r"\_")


def _at(operand: tree.Expression, index: str) -> str:
    """A value with its sample as index; a value with an index is put in parentheses."""
    # a name with an underscore has an index already, of its second word
    if isinstance(operand, tree.Name) and "_" not in operand.name:
        return f"{name_latex(operand.name)}_{{{index}}}"
    # an index behind an index is an error in LaTeX
    return rf"\left({expression_latex(operand)}\right)_{{{index}}}"


def _length(length: tree.Samples | tree.Duration) -> str:
    if isinstance(length, tree.Samples):
        return str(length.count)
    return rf"\mathrm{{{length_text(length).replace(' ', chr(92) + ',')}}}"


def _call(call: tree.Call) -> str:
    arguments = [expression_latex(argument) for argument in call.arguments]
    name = call.function.name
    if isinstance(call.function, tree.Name) and len(arguments) == 1 and not call.keywords:
        if name == "sqrt":
            return rf"\sqrt{{{arguments[0]}}}"
        if name == "abs":
            return rf"\left|{arguments[0]}\right|"
        if name == "der":
            return rf"\frac{{d}}{{dt}} {_within(call.arguments[0], ATOM)}"
    arguments += [f"{_letter(w.name)} = {expression_latex(w.value)}" for w in call.keywords]
    return rf"{_function(call.function)}\left({', '.join(arguments)}\right)"


def _function(function: tree.Name | tree.Member) -> str:
    match function:
        case tree.Name(name=name) if name in _FUNCTIONS:
            return rf"\{name}"
        case tree.Name(name=name) if name in _ARC:
            return rf"\{_ARC[name]}"
        case tree.Name(name=name) if len(name) > 1 and "_" not in name:
            return rf"\operatorname{{{name}}}"
        case _:
            return expression_latex(function)


def _binary(operator: tree.Operator, left: tree.Expression, right: tree.Expression) -> str:
    if operator is tree.Operator.DIVIDE:
        return rf"\frac{{{expression_latex(left)}}}{{{expression_latex(right)}}}"
    if operator is tree.Operator.POWER:
        # braces keep an exponent from joining the one within
        return f"{{{_within(left, ATOM)}}}^{{{expression_latex(right)}}}"
    least = binding_of_operands(operator)
    second, joint = expression_latex(right), _JOINTS[operator]
    # a number behind a thin space would read as a factor of it: `2 3`
    if operator is tree.Operator.MULTIPLY and second[:1].isdigit():
        joint = r" \cdot "
    return f"{_within(left, least)}{joint}{_enclosed(second, right, least + 1)}"


def _within(expression: tree.Expression, least: int) -> str:
    return _enclosed(expression_latex(expression), expression, least)


def _enclosed(text: str, expression: tree.Expression, least: int) -> str:
    """The text of an expression, in parentheses if its precedence is too low."""
    return text if binding(expression) >= least else rf"\left({text}\right)"
