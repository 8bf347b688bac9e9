"""E0320-E0399: the grammar of expressions."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span


def _error(
    code: str, message: str, span: Span, label: str = "", repair: str | None = None
) -> Diagnostic:
    return Diagnostic(code, "error", message, span, label, help=repair)


def foreign_character(character: str, span: Span, repair: str | None) -> Diagnostic:
    """E0320: a character that expressions do not have."""
    shown = character if character.isprintable() else f"U+{ord(character):04X}"
    message = f"`{shown}` does not belong in an expression"
    return _error("E0320", message, span, "unexpected character", repair)


def caret(span: Span) -> Diagnostic:
    """E0321: `^` for a power."""
    return _error("E0321", "`^` is not a power here", span, "bitwise in Python", "write `**`")


def unbalanced_bracket(bracket: str, span: Span, closing: bool) -> Diagnostic:
    """E0322: a bracket without its partner."""
    said = "closes nothing" if closing else "is never closed"
    repair = (
        "remove it, or open one before it" if closing else f"close it with `{_CLOSING[bracket]}`"
    )
    return _error("E0322", f"`{bracket}` {said}", span, "no partner", repair)


_CLOSING = {"(": ")", "[": "]"}


def malformed_expression(span: Span) -> Diagnostic:
    """E0323: a text that is not an expression, without a better explanation."""
    return _error("E0323", "this is not an expression", span, "cannot be read from here on")


def assignment(span: Span) -> Diagnostic:
    """E0354: `a = …`, as in a program."""
    message = "an expression has a value and assigns none: it has no `=`"
    repair = "write only what is right of `=`; the key is the name"
    return _error("E0354", message, span, "an assignment", repair)


def incomplete_expression(span: Span) -> Diagnostic:
    """E0347: an expression that stops in its middle."""
    message = "the expression ends too early"
    return _error("E0347", message, span, "something is missing after this")


def empty_list(span: Span) -> Diagnostic:
    """E0348: a list without elements."""
    return _error("E0348", "a list has at least one element", span, "holds nothing")


def too_long(length: int, longest: int, span: Span) -> Diagnostic:
    """E0324: an expression above the cap of characters."""
    message = f"the expression has {length} characters, more than {longest}"
    return _error("E0324", message, span, "too long", "split it into named equations")


def too_deep(deepest: int, span: Span) -> Diagnostic:
    """E0325: an expression nested above the cap."""
    message = f"the expression is nested deeper than {deepest} levels"
    return _error("E0325", message, span, "too deep", "split it into named equations")


def text_in_expression(span: Span) -> Diagnostic:
    """E0326: a quoted text."""
    return _error("E0326", "expressions have no texts", span, "remove the quotes")


def stray_comparison(span: Span) -> Diagnostic:
    """E0327: a comparison elsewhere than as the condition of `where`."""
    message = "a comparison stands only as the first argument of `where`"
    return _error("E0327", message, span, "not a number", "write `where(condition, 1, 0)`")


def chained_comparison(span: Span) -> Diagnostic:
    """E0328: `a < b < c`."""
    message = "comparisons cannot be chained"
    repair = "nest two `where`, or compare with the distance from the middle of the range"
    return _error("E0328", message, span, "more than one comparison", repair)


def equality(operator: str, span: Span) -> Diagnostic:
    """E0329: `==` and `!=`."""
    message = f"`{operator}` does not compare real numbers"
    repair = "use <, <=, > or >=, for example `where(abs(a - b) < 0.5, 1, 0)`"
    return _error("E0329", message, span, "not in the language", repair)


def boolean_word(word: str, span: Span) -> Diagnostic:
    """E0330: and, or, not."""
    return _error(
        "E0330", f"`{word}` is not in the language", span, "no logic on numbers", "nest `where`"
    )


def python_word(word: str, span: Span) -> Diagnostic:
    """E0331: another word of Python."""
    message = f"`{word}` cannot be used in an expression"
    return _error("E0331", message, span, "a word of Python", "a choice is written with `where`")


def calls_no_name(span: Span) -> Diagnostic:
    """E0332: a call of something that is not a layer, function or builtin."""
    message = "only a layer, a function or a builtin can be called"
    return _error("E0332", message, span, "not a name", "a product needs `*`")


def malformed_time(span: Span) -> Diagnostic:
    """E0333: something else than t, t+k, t-k in a window."""
    message = "time is `t`, `t+k` or `t-k`, with k in samples or a duration"
    return _error("E0333", message, span, "not a time", "write for example `x[t-1]`")


def open_window(span: Span) -> Diagnostic:
    """E0334: a window without both ends, or with a step."""
    message = "a window has two ends and no step"
    return _error("E0334", message, span, "not a window", "write for example `x[t-4:t]`")


def unpacked_argument(span: Span) -> Diagnostic:
    """E0335: `*a` or `**a` in a call."""
    return _error("E0335", "arguments cannot be unpacked", span, "write the arguments one by one")


def malformed_number(text: str, span: Span) -> Diagnostic:
    """E0336: a number with leading zeros."""
    repair = f"write `{text.lstrip('0') or '0'}`"
    return _error("E0336", f"`{text}` has leading zeros", span, "octal in some languages", repair)


def foreign_operator(operator: str, span: Span) -> Diagnostic:
    """E0337: an operator of Python that the language does not have."""
    message = f"the operator `{operator}` is not in the language"
    return _error("E0337", message, span, "operators are + - * / @ **")


def empty_expression(span: Span) -> Diagnostic:
    """E0338: nothing written."""
    return _error("E0338", "the expression is empty", span, "nothing here")


def missing_operator(left: str, right: str, span: Span, is_unit: bool = False) -> Diagnostic:
    """E0339: two operands side by side; maybe a number with a unit that no duration has."""
    message = f"an operator is missing between `{left}` and `{right}`"
    repair = f"for a product write `{left} * {right}`"
    if is_unit:
        repair += "; a duration is in us, ms, s, min or h, and other units go into `unit:`"
    return _error("E0339", message, span, "two operands", repair)


def malformed_word(word: str, span: Span) -> Diagnostic:
    """E0340: a word that cannot be a name."""
    if any(character in "²³" for character in word):
        return _error("E0340", f"`{word}` is not a name", span, "not a letter", "a power is `x**2`")
    label = "a name is made of Latin or Greek letters, digits and `_`, and starts with a letter"
    return _error("E0340", f"`{word}` is not a name", span, label)


def several_values(span: Span, number: str | None = None) -> Diagnostic:
    """E0341: `a, b` without brackets."""
    repair = (
        f"for a decimal point write `{number}`; a list needs [ ]" if number else "a list needs [ ]"
    )
    return _error("E0341", "an expression has one value", span, "several", repair)


def malformed_window_length(method: str, span: Span) -> Diagnostic:
    """E0342: `.past()` or `.future()` without one length."""
    message = f"`.{method}( )` takes one length, in samples or as a duration"
    return _error("E0342", message, span, "not a length", f"write for example `x.{method}(1 s)`")


def repeated_keyword(name: str, span: Span, first: Span) -> Diagnostic:
    """E0343: a keyword given twice in a call."""
    return Diagnostic(
        "E0343",
        "error",
        f"`{name}=` is given twice",
        span,
        "again here",
        secondary=((first, "first here"),),
    )


def long_member(span: Span) -> Diagnostic:
    """E0344: a member of something that is not a name."""
    return _error("E0344", "only a name has members", span, "write `name.member`")


def huge_number(text: str, span: Span) -> Diagnostic:
    """E0345: a literal that no float holds."""
    return _error("E0345", f"`{text}` is too large for a float64", span, "infinite")


def foreign_construct(span: Span) -> Diagnostic:
    """E0346: Python that the whitelist does not admit."""
    return _error("E0346", "this is Python, but not part of the language", span, "not admitted")
