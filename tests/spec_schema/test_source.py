"""Offsets and places are translated as editors count them."""

from hypothesis import given
from hypothesis import strategies as st

from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.diagnostics.suggest import nearest


def test_lines_end_as_in_editors() -> None:
    source = SourceText("a", "one\r\ntwo\rthree\n\nfive")
    assert [source.line(n) for n in range(1, source.line_count + 1)] == [
        "one",
        "two",
        "three",
        "",
        "five",
    ]
    assert source.position(5) == (2, 1)
    assert source.span(9, 14) == Span(file="a", line=3, column=1, end_line=3, end_column=6)
    assert source.span(9, 10_000).end_line == 5


@given(st.text("ab\r\n"), st.data())
def test_position_and_line_agree(text: str, data: st.DataObject) -> None:
    source = SourceText("a", text)
    offset = data.draw(st.integers(0, len(text)))
    line, column = source.position(offset)
    if column <= len(source.line(line)):
        assert source.line(line)[column - 1] == text[offset]


def test_span_to_the_end_of_another() -> None:
    source = SourceText("a", "x = y\nz")
    assert source.span(0, 1).to(source.span(6, 7)) == Span(
        file="a", line=1, column=1, end_line=2, end_column=2
    )


def test_nearest() -> None:
    known = ("window", "out", "bias", "init")
    assert nearest("widnow", known) == "window"
    assert nearest("Window", known) == "window"
    assert nearest("windows", known) == "window"
    assert nearest("nothing", known) is None
    assert nearest("kk", ("k", "c")) == "k"
    assert nearest("q", ("k", "c")) is None
    assert nearest("x" * 1000, known) is None
