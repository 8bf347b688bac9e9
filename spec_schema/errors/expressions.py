"""E0320-E0399: the grammar of expressions."""

import re

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import with_point_or_joined
from spec_schema.names import LONGEST_NAME


def foreign_character(
    character: str, span: Span, meant: str | None, repair: str | None
) -> Diagnostic:
    """E0320: a character that is not allowed in expressions."""
    # what no terminal shows would leave the sentence with a hole: its code point instead
    shown = character if character.isprintable() else f"U+{ord(character):04X}"
    message = f"`{shown}` does not belong in an expression"
    return error("E0320", span, message, "unexpected character", help=repair, replacement=meant)


def caret(span: Span) -> Diagnostic:
    """E0321: `^` for a power."""
    # no exclusive or is ever meant in a formula, so the replacement is safe for editors
    message, label = "`^` is not a power here", "bitwise in Python"
    return error("E0321", span, message, label, help="write `**`", replacement="**")


def unbalanced_bracket(bracket: str, span: Span, closing: bool) -> Diagnostic:
    """E0322: an unmatched bracket."""
    said = "closes nothing" if closing else "is never closed"
    repair = (
        "remove it, or open one before it" if closing else f"close it with `{_CLOSING[bracket]}`"
    )
    return error("E0322", span, f"`{bracket}` {said}", "no partner", help=repair)


_THOUSANDS = re.compile(r"(\d{3}|(?:_\d+)+)")
_CLOSING = {"(": ")", "[": "]"}


def malformed_expression(span: Span) -> Diagnostic:
    """E0323: a text that is not a valid expression, without a more specific code."""
    return error("E0323", span, "this is not an expression", "cannot be read from here on")


def assignment(span: Span) -> Diagnostic:
    """E0354: `a = …`, as in a program."""
    message = "an expression has a value and assigns none: it has no `=`"
    repair = "write only what is right of `=`; the key is the name"
    return error("E0354", span, message, "an assignment", help=repair)


def incomplete_expression(span: Span) -> Diagnostic:
    """E0347: an expression that stops in its middle."""
    message = "the expression ends too early"
    return error("E0347", span, message, "something is missing after this")


def empty_list(span: Span) -> Diagnostic:
    """E0348: a list without elements."""
    return error("E0348", span, "a list has at least one element", "holds nothing")


def too_long(length: int, longest: int, span: Span) -> Diagnostic:
    """E0324: an expression with too many characters."""
    message = f"the expression has {length} characters, more than {longest}"
    return error("E0324", span, message, "too long", help="split it into named equations")


def too_deep(deepest: int, span: Span) -> Diagnostic:
    """E0325: an expression with too deep nesting."""
    message = f"the expression is nested deeper than {deepest} levels"
    return error("E0325", span, message, "too deep", help="split it into named equations")


def text_in_expression(span: Span) -> Diagnostic:
    """E0326: a quoted text."""
    return error("E0326", span, "expressions have no texts", "remove the quotes")


def stray_comparison(span: Span) -> Diagnostic:
    """E0327: a comparison outside the condition of `where`."""
    message = "a comparison stands only as the first argument of `where`"
    return error("E0327", span, message, "not a number", help="write `where(condition, 1, 0)`")


def chained_comparison(span: Span) -> Diagnostic:
    """E0328: `a < b < c`."""
    message = "comparisons cannot be chained"
    repair = "nest two `where`, or compare with the distance from the middle of the range"
    return error("E0328", span, message, "more than one comparison", help=repair)


def equality(operator: str, span: Span) -> Diagnostic:
    """E0329: `==` and `!=`."""
    message = f"`{operator}` does not compare real numbers"
    repair = "use <, <=, > or >=, for example `where(abs(a - b) < 0.5, 1, 0)`"
    return error("E0329", span, message, "not in the language", help=repair)


def boolean_word(word: str, span: Span) -> Diagnostic:
    """E0330: and, or, not."""
    message = f"`{word}` is not in the language"
    return error("E0330", span, message, "no logic on numbers", help="nest `where`")


def python_word(word: str, span: Span) -> Diagnostic:
    """E0331: a keyword of Python other than `and`, `or` and `not` in an expression."""
    message = f"`{word}` cannot be used in an expression"
    # only these have a counterpart: a spec has no loops, imports or functions of that kind
    repair = _CHOICE if word in {"if", "else"} else None
    return error("E0331", span, message, "a word of Python", help=repair)


_CHOICE = "a choice is `where(condition, then, otherwise)`, such as `where(x > 0, 1, 0)`"


def calls_no_name(span: Span) -> Diagnostic:
    """E0332: a call of something that is not a layer, function or builtin."""
    message = "only a layer, a function or a builtin can be called"
    return error("E0332", span, message, "not a name", help="a product needs `*`")


def malformed_time(span: Span, meant: str | None = None, element: str | None = None) -> Diagnostic:
    """E0333: something else than t, t+k, t-k in a window."""
    message = "time is `t`, `t+k` or `t-k`, with k in samples or a duration"
    repair = "write for example `x[t-1]`, or `x[t-4:t]` for a window"
    if element is not None:  # a number stands in its place
        repair += f"; an element of an array is `part(x, {element})`"
    if meant is not None:
        repair = f"write `{meant}`: the present sample is `t`"
    return error("E0333", span, message, "not a time", help=repair, replacement=meant)


def open_window(span: Span) -> Diagnostic:
    """E0334: a window without both ends, or with a step."""
    message = "a window has two ends and no step"
    return error("E0334", span, message, "not a window", help="write for example `x[t-4:t]`")


def unpacked_argument(span: Span) -> Diagnostic:
    """E0335: `*a` or `**a` in a call."""
    return error("E0335", span, "arguments cannot be unpacked", "write the arguments one by one")


def malformed_number(text: str, span: Span) -> Diagnostic:
    """E0336: a number with leading zeros."""
    # zeros alone are the number 0
    meant = text.lstrip("0") or "0"
    message, label = f"`{text}` has leading zeros", "octal in some languages"
    return error("E0336", span, message, label, help=f"write `{meant}`", replacement=meant)


def foreign_operator(operator: str, span: Span) -> Diagnostic:
    """E0337: an operator of Python that the language does not have."""
    message = f"the operator `{operator}` is not in the language"
    # others, such as `%`, have no counterpart: the label lists the operators that there are
    repair = _OPERATORS.get(operator)
    return error("E0337", span, message, "operators are + - * / @ **", help=repair)


_OPERATORS = {
    "|": "for a magnitude write `abs(…)`",
    "&&": "there is no logic on numbers; nest `where`",
    "||": "there is no logic on numbers; nest `where`",
    "&": "there is no logic on numbers; nest `where`",
}


def empty_expression(span: Span) -> Diagnostic:
    """E0338: nothing written."""
    return error("E0338", span, "the expression is empty", "nothing here")


def missing_operator(left: str, right: str, span: Span, is_unit: bool = False) -> Diagnostic:
    """E0339: two operands side by side; maybe a number with a unit that no duration has."""
    message = f"an operator is missing between `{left}` and `{right}`"
    product = f"{left} * {right}"
    if joined := _one_number(left, right):
        # a product of 1 and 200 would be another number than the one that was meant
        repair = f"write `{joined}`: the digits of a number stand together"
        return error("E0339", span, message, "two operands", help=repair)
    repair = f"for a product write `{product}`"
    # no replacement then: `3 * bar` would be a name that nobody declared
    if is_unit:
        repair += "; a duration is in us, ms, s, min or h, and other units go into `unit:`"
    meant = None if is_unit else product
    return error("E0339", span, message, "two operands", help=repair, replacement=meant)


def _one_number(left: str, right: str) -> str | None:
    """`1200` of `1 200` and `1_200`."""
    grouped = _THOUSANDS.fullmatch(right)
    return left + grouped[1].replace("_", "") if grouped and left.isdecimal() else None


def malformed_word(word: str, span: Span) -> Diagnostic:
    """E0340: a word that cannot be a name."""
    if len(word) > LONGEST_NAME:
        message = f"`{word[:20]}…` is too long for a name"
        repair = f"a name has at most {LONGEST_NAME} characters"
        return error("E0340", span, message, f"{len(word)} characters", help=repair)
    # letters to Python (`str.isalnum`), so they come here as a part of a word
    if any(character in "²³" for character in word):
        repair = "a power is `x**2`"
        return error("E0340", span, f"`{word}` is not a name", "not a letter", help=repair)
    label = "a name is made of Latin or Greek letters, digits and `_`, and starts with a letter"
    return error("E0340", span, f"`{word}` is not a name", label)


def several_values(span: Span, number: str | None = None) -> Diagnostic:
    """E0341: `a, b` without brackets."""
    message, repair, meant = "an expression has one value", "a list needs [ ]", None
    if number is not None:
        *joined, point = with_point_or_joined(number)
        repair = f"for a decimal point write `{point}`; {repair}"
        # no replacement of what may be a thousand times as much
        if joined:
            repair = f"where the comma parts thousands write `{joined[0]}`, {repair}"
        else:
            meant = point
    return error("E0341", span, message, "several", help=repair, replacement=meant)


def malformed_window_length(method: str, span: Span) -> Diagnostic:
    """E0342: `.past()` or `.future()` without one length."""
    message = f"`.{method}( )` takes one length, in samples or as a duration"
    repair = f"write for example `x.{method}(1 s)`"
    return error("E0342", span, message, "not a length", help=repair)


def repeated_keyword(name: str, span: Span, first: Span) -> Diagnostic:
    """E0343: a keyword given twice in a call."""
    message = f"`{name}=` is given twice"
    return error("E0343", span, message, "again here", secondary=((first, "first here"),))


def long_member(span: Span) -> Diagnostic:
    """E0344: a member of something that is not a name."""
    return error("E0344", span, "only a name has members", "write `name.member`")


def huge_number(text: str, span: Span) -> Diagnostic:
    """E0345: a literal that no float holds."""
    return error("E0345", span, f"`{text}` is too large for a float64", "infinite")


def foreign_construct(span: Span) -> Diagnostic:
    """E0346: Python syntax that is not part of the language."""
    return error("E0346", span, "this is Python, but not part of the language", "not admitted")
