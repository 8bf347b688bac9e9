"""Expressions are read as the grammar says, printed back the same, and never evaluated."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.parser import LONGEST, parse_expression
from spec_schema.expressions.scanner import DEEPEST
from spec_schema.expressions.tree import (
    Binary,
    Call,
    Compare,
    Duration,
    Expression,
    Future,
    Keyword,
    ListLiteral,
    Member,
    Name,
    Negate,
    Number,
    Operator,
    Past,
    Relation,
    Samples,
    TimeOffset,
    Window,
    expression_text,
)
from spec_schema.units.quantity import Quantity
from spec_schema.units.unit import unit_symbol

_SPAN = Span(file="", line=1, column=1, end_line=1, end_column=1)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("a+b * c", "a + b * c"),
        ("(a+b)*c", "(a + b) * c"),
        ("a-(b-c)", "a - (b - c)"),
        ("(a-b)-c", "a - b - c"),
        ("a/(b*c)", "a / (b * c)"),
        ("A @ (B @ x)", "A @ (B @ x)"),
        ("-x**2", "-x**2"),
        ("(-x)**2", "(-x)**2"),
        ("x**-y", "x**-y"),
        ("a**b**c", "a**b**c"),
        ("(a**b)**c", "(a**b)**c"),
        ("- -x", "--x"),
        ("+x", "x"),
        ("x[t]", "x[t]"),
        ("x[t - 4 : t]", "x[t-4:t]"),
        ("x[t-1 s:t+50 ms]", "x[t-1 s:t+50 ms]"),
        ("x.past(1.5 s)", "x.past(1.5 s)"),
        ("x.future( 3 )", "x.future(3)"),
        ("q.meas[t+1]", "q.meas[t+1]"),
        ("f(x, over=[a, b], method=forward)", "f(x, over=[a, b], method=forward)"),
        ("where(a <= b, 1, -1)", "where(a <= b, 1, -1)"),
        ("[1, [2.5, 3e-7]]", "[1, [2.5, 3e-07]]"),
        ("a +\n  b  # why\n  - c", "a + b - c"),
        ("Δω1 * μ", "Δω1 * μ"),
        ("x . past (3)", "x.past(3)"),
        ("(a + b)[t-1]", "(a + b)[t-1]"),
        ("1.e3 + .5", "1000 + 0.5"),
    ],
)
def test_reads_and_prints(text: str, canonical: str) -> None:
    assert expression_text(_parsed(text)) == canonical


def test_precedence_is_that_of_the_grammar() -> None:
    a, b, c = (Name(name, _SPAN) for name in "abc")
    product = Binary(operator=Operator.MULTIPLY, left=b, right=c, span=_SPAN, operator_span=_SPAN)
    assert _parsed("a + b * c") == Binary(
        operator=Operator.ADD, left=a, right=product, span=_SPAN, operator_span=_SPAN
    )
    power = Binary(
        operator=Operator.POWER, left=a, right=Number(2.0, _SPAN), span=_SPAN, operator_span=_SPAN
    )
    assert _parsed("-a**2") == Negate(power, _SPAN)


def test_places_are_those_of_the_parts() -> None:
    expression = _parsed("α * (bb -\n cc[t-1 s])")
    assert isinstance(expression, Binary)
    assert isinstance(expression.right, Binary)
    inner = expression.right.right
    assert isinstance(inner, Window)
    assert _columns(expression.left) == (1, 1, 2)
    assert _columns(expression.right.left) == (1, 6, 8)
    assert _columns(inner) == (2, 2, 11)
    assert (inner.first.span.column, inner.first.span.end_column) == (5, 10)
    assert expression.operator_span.column == 3
    assert expression.right.operator_span.column == 9


def test_position_makes_no_difference() -> None:
    assert _parsed("a+b") == _parsed("  a  +  b")
    assert hash(_parsed("x[t-1]")) == hash(_parsed("x[ t - 1 ]"))


def test_tower_of_powers_is_read_and_not_computed() -> None:
    assert expression_text(_parsed("9**9**9**9")) == "9**9**9**9"


def test_caps() -> None:
    assert isinstance(_parsed("+".join("a" * DEEPEST)), Binary)
    assert _codes("+".join("a" * (DEEPEST + 2))) == {"E0325"}
    assert _codes("x" * (LONGEST + 1)) == {"E0324"}
    assert _codes("(" * 200 + "x" + ")" * 200) == {"E0325"}
    # Python's own parser gives up on these with RecursionError or MemoryError.
    assert _codes("-" * 3999 + "x") == {"E0325"}


def test_comparison_only_as_a_condition() -> None:
    assert _codes("where(1, a > b, 2)") == {"E0327"}
    assert _codes("where((a > b) * 1, 1, 2)") == {"E0327"}
    assert _codes("f(a > b)") == {"E0327"}


def test_all_faults_of_an_expression_are_said() -> None:
    assert _codes("x[0] + sin(a)(b) + f(*c)") == {"E0333", "E0332", "E0335"}


_NAMES = st.sampled_from(["a", "b2", "ω", "x_dot", "ms", "s", "sum"])
_NUMBERS = st.floats(0, 1e300, allow_nan=False).map(lambda value: Number(value, _SPAN))


def _duration(value: float, unit: str) -> Duration:
    return Duration(Quantity(value, unit_symbol(unit), _SPAN), _SPAN)


_DURATIONS = st.builds(_duration, st.floats(0, 1e6), st.sampled_from(["us", "ms", "s", "min", "h"]))
_LENGTHS = st.builds(Samples, st.integers(0, 999), st.just(_SPAN)) | _DURATIONS
_TIMES = st.builds(TimeOffset, st.just(1), st.just(Samples(0, _SPAN)), st.just(_SPAN)) | st.builds(
    TimeOffset,
    st.sampled_from([1, -1]),
    st.builds(Samples, st.integers(1, 99), st.just(_SPAN)) | _DURATIONS,
    st.just(_SPAN),
)
_FUNCTIONS = st.builds(Name, _NAMES, st.just(_SPAN)) | st.builds(
    Member, _NAMES, _NAMES, st.just(_SPAN)
)


def _larger(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    here = st.just(_SPAN)
    keywords = st.lists(st.tuples(_NAMES, inner), max_size=2).map(
        lambda pairs: tuple(Keyword(name, value, _SPAN) for name, value in dict(pairs).items())
    )
    condition = st.builds(Compare, st.sampled_from(Relation), inner, inner, here)
    several = st.lists(inner, max_size=3).map(tuple)
    where = st.builds(
        lambda test, rest: Call(Name("where", _SPAN), (test, *rest), (), _SPAN), condition, several
    )
    return (
        st.builds(Negate, inner, here)
        | st.builds(
            Binary,
            operator=st.sampled_from(Operator),
            left=inner,
            right=inner,
            span=here,
            operator_span=here,
        )
        | st.builds(Call, _FUNCTIONS, several, keywords, here)
        | where
        | st.builds(Window, inner, _TIMES, st.none() | _TIMES, here)
        | st.builds(Past, inner, _LENGTHS, here)
        | st.builds(Future, inner, _LENGTHS, here)
        | st.builds(ListLiteral, several.filter(len), here)
    )


_ATOMS: st.SearchStrategy[Expression] = _NUMBERS | _DURATIONS | _FUNCTIONS


@settings(max_examples=300, deadline=None)
@given(st.recursive(_ATOMS, _larger, max_leaves=12))
def test_print_and_parse_is_identity(expression: Expression) -> None:
    assert parse_expression(expression_text(expression)) == expression


_WORDS = "x t 1 2.5 s ms + - * / @ ** ( ) [ ] : , . = < > past where for _ # \n"


@settings(max_examples=500, deadline=None)
@given(st.lists(st.sampled_from(_WORDS.split(" ")) | st.text(max_size=4), max_size=25).map("".join))
def test_any_text_is_an_expression_or_diagnostics(text: str) -> None:
    findings = Findings()
    expression = parse_expression(text, findings=findings)
    assert (expression is None) == findings.failed
    if expression is not None:
        assert parse_expression(expression_text(expression)) == expression


def _parsed(text: str) -> Expression:
    expression = parse_expression(text)
    assert expression is not None
    return expression


def _codes(text: str) -> set[str]:
    with pytest.raises(SpecError) as caught:
        parse_expression(text)
    return {diagnostic.code for diagnostic in caught.value.diagnostics}


def _columns(expression: Expression) -> tuple[int, int, int]:
    span = expression.span
    return span.line, span.column, span.end_column
