"""Comments on a matrix in generated code: names, units, and the sparsity pattern."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from compiler.ir.rules import quotient_unit
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix, MatrixBlock, Member, Vector

_MOST_ROWS, _MOST_COLUMNS = 32, 64
"""Maximum size of a matrix whose pattern is shown; the JSON file has every pattern."""


def pattern_comments(matrix: Matrix) -> Iterator[str]:
    """One line of marks per row, one mark per entry; consecutive equal rows share a line."""
    rows, columns = matrix.shape
    if rows > _MOST_ROWS or columns > _MOST_COLUMNS:
        return
    yield ". is always 0, = always the same number, p made of parameters only, * computed"
    names = [name for member in matrix.rows.members for name in _element_names(member)]
    for marks, equal in groupby(range(rows), lambda row: _row_marks(matrix, row)):
        first, *others = equal
        yield f"{marks}  {names[first]}" + (f" .. {names[others[-1]]}" if others else "")


def _row_marks(matrix: Matrix, row: int) -> str:
    columns = matrix.columns.size
    marks = "".join(mark(matrix, row * columns + column) for column in range(columns))
    return " ".join(marks[m.first : m.first + m.size] for m in matrix.columns.members)


def mark(matrix: Matrix, entry: int) -> str:
    """The kind of an entry, as one character."""
    known = matrix.known[entry]
    if known is not None:
        return "." if known == 0.0 else "="
    return "p" if matrix.fixed[entry] else "*"


def entries_comment(matrix: Matrix, block: MatrixBlock, type: Type) -> str:
    """The comment of the entries that a block writes: `d speed / d torque [m/s/N/m]`."""
    places = block.places(type.shape).ravel()
    row, first = divmod(int(places[0]), matrix.columns.size)
    last = int(places[-1]) % matrix.columns.size
    of, by = _member_at(matrix.rows, row), _member_at(matrix.columns, first)
    unit = quotient_unit(of.unit, by.unit)
    following = "next " if matrix.rows.letter == "x" else ""
    text = f"d {following}{_element_name(of, row)} / d {_element_name(by, first)}"
    if last != first:
        text += f" .. {_element_name(by, last)}"
    return text + (f" [{unit.text}]" if unit is not None else "")


def _member_at(vector: Vector, place: int) -> Member:
    return next(m for m in vector.members if m.first <= place < m.first + m.size)


def _element_name(member: Member, place: int) -> str:
    return f"{member.name}[{place - member.first}]" if member.axes else member.name


def _element_names(member: Member) -> list[str]:
    return [_element_name(member, member.first + number) for number in range(member.size)]
